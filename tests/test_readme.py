"""The README tells the truth: its commands and its Python run, its files exist, its keys are the scenario's."""

import re
import shlex
import sys
from dataclasses import fields
from pathlib import Path

import pytest

from gtmbench.cli.app import app, main
from gtmbench.faults.kinds import FAULTS
from gtmbench.study.scenario import AlarmSetup, OperatorSetup, Setup

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text()
MAKEFILE = (ROOT / "Makefile").read_text()


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def commands():
    lines = [line.split("#")[0].strip() for block in blocks("sh") for line in block.splitlines()]
    return [line for line in lines if line]


def mentioned():
    """Return the commands within sentences; a number stands for what is left open."""
    sentences = re.sub(r"```.*?```", "", README, flags=re.DOTALL).replace("\n", " ")
    return [line.replace(" N", " 7") for line in re.findall(r"`(gtmbench [a-z][^`]*)`", sentences)]


@pytest.mark.parametrize("line", sorted({line for line in (*commands(), *mentioned()) if line.startswith("gtmbench")}))
def test_every_command_parses(line):
    _, command, *arguments = shlex.split(line)
    assert command in app.commands
    if arguments or line in commands():
        app.commands[command].make_context(command, arguments)


def test_every_make_target_exists():
    wanted = [line.split()[1] for line in commands() if line.startswith("make ")]
    assert wanted[:2] == ["run", "test"]
    for target in {*wanted, *re.findall(r"`make (\w+)`", README)}:
        assert re.search(rf"^{target}:", MAKEFILE, flags=re.MULTILINE), target


CHEAP = {  # what is added to a command; `test_wheel` runs the whole study
    "gtmbench run": "jam --no-figures",
    "gtmbench run drift jam": "--no-figures --no-recording",
    "gtmbench run jam": "--no-figures --no-recording",
    "gtmbench calibrate": "--flights 3",
    "gtmbench run --detector": "jam --no-figures --no-recording",
}


def test_the_commands_run_as_one_chain(tmp_path, monkeypatch, capsys):
    """In one folder, each with what those before it wrote; `view` opens a window, so here it has only to get there."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("gtmbench.study.calibration.FLIGHTS", 2)
    monkeypatch.setattr("os.cpu_count", lambda: 1)  # flights are flown in turn
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    chain = [line for line in commands() if line.startswith("gtmbench")]
    assert len(chain) >= 7
    for line in chain:
        cheap = CHEAP.get(max((known for known in CHEAP if line.startswith(known)), key=len, default=""), "")
        with pytest.raises(SystemExit) as ended:
            main(shlex.split(f"{line} {cheap}")[1:])
        out, err = capsys.readouterr()
        if " view " in line and sys.platform == "linux":
            assert "there is no screen here" in err
        else:
            assert (ended.value.code, err) == (0, ""), line
            assert out
        if line == "gtmbench check":
            assert "no figure is worse" in out


def test_the_python_runs(capsys):
    exec("\n".join(blocks("python")), {})
    printed = capsys.readouterr().out
    assert "[p q beta] -> r (101, 1, 3)" in printed
    alarms = re.findall(r"^\[(\d+\.\d+)", printed, flags=re.MULTILINE) + re.findall(r"alarm at \[(\d+\.\d+)", printed)
    assert len(alarms) > 1
    assert alarms[0] == alarms[1], "the stream's first alarm is the batch's"


def test_every_file_that_is_named_exists():
    text = README + (ROOT / "experiments/README.md").read_text()
    named = re.findall(r"`((?:gtmbench|aircraft|experiments|faults|tests)/[\w./]+)`", text)
    pictures = re.findall(r"\]\((experiments/[^)]+)\)", text)
    assert len(named) > 10
    assert len(pictures) == 10
    for name in named + pictures:
        if "NAME" not in name:
            assert (ROOT / name).exists(), name


def test_every_scenario_key_stands_in_its_table():
    keys = {item.name for item in fields(Setup)} - {"operator", "alarm"}
    keys |= {item.name for table in (OperatorSetup, AlarmSetup) for item in fields(table)}
    keys |= {parameter.name for kind in FAULTS.values() for parameter in kind.parameters()}
    table = README.split("## A scenario file")[1].split("\n## ")[0]
    for key in keys:
        assert re.search(rf"[`.]{key}`", table), key
