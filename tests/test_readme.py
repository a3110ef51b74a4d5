"""The README tells the truth: its commands and its Python run, its files exist, its keys are the scenario's."""

import re
import shlex
import sys
from dataclasses import fields
from pathlib import Path

import pytest

from gtmbench.cli.app import main
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


def test_every_make_target_exists():
    wanted = [line.split()[1] for line in commands() if line.startswith("make ")]
    assert wanted[:2] == ["run", "test"]
    for target in {*wanted, *re.findall(r"`make (\w+)`", README)}:
        assert re.search(rf"^{target}:", MAKEFILE, flags=re.MULTILINE), target


def test_every_gtmbench_command_runs_in_order(tmp_path, monkeypatch, capsys):
    """`view` opens a window, so here it has only to accept the recording that the line before it wrote."""
    monkeypatch.chdir(tmp_path)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    ran = [line for line in commands() if line.startswith("gtmbench")]
    assert len(ran) >= 7
    for line in ran:
        with pytest.raises(SystemExit) as ended:
            main(shlex.split(line)[1:])
        out, err = capsys.readouterr()
        if " view " in line and sys.platform == "linux":
            assert "there is no screen here" in err
        else:
            assert (ended.value.code, err) == (0, ""), line
            assert out


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
    assert len(pictures) == 9
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
