"""Sixteen commands: each help begins with what it is for and an example that runs; old names print the new ones."""

import re
import shutil

import pytest

import gtmbench as gb
from gtmbench.cli.app import SECTIONS
from gtmbench.cli.output import moved_command
from tests.helpers.autopilot_logs import ardupilot, broken
from tests.helpers.commands import COMMANDS
from tests.helpers.hostile import refused
from tests.helpers.pages import ROOT, commands, run_chain

EXAMPLES = {
    name: re.search(r"^ *Example: (gtmbench .*)$", command.help, flags=re.MULTILINE)[1]
    for name, command in COMMANDS.items()
}
OLD = ("bank", "trim", "autopilot", "new", "report", "rescue", "diff")
# in the order in which one writes what the next reads
CHAIN = (
    *("fly", "monitor", "inject", "calibrate", "list", "export", "aircraft", "run", "verify", "view", "campaign"),
    *("score", "check"),
)
ELSEWHERE = {"demo", "live"}  # run by test_readme as they stand; `demo` also by test_demo
LONG = {"benchmark"}  # minutes; test_cli_benchmark runs a small one


def test_the_commands_are_sixteen():
    assert len(COMMANDS) == 16
    assert [name for commands in SECTIONS.values() for name in commands] == [*COMMANDS]
    assert all(command.name == name for name, command in COMMANDS.items())


@pytest.mark.parametrize("name", COMMANDS)
def test_help_begins_with_a_plain_line_and_an_example(name, cli):
    code, out, _ = cli(name, "--help")
    assert code == 0
    assert "--json" in out
    first, example = (" ".join(part.split()) for part in out.split("\n\n")[1:3])
    assert first.endswith(".")
    assert 30 < len(first) < 130
    assert example == f"Example: {EXAMPLES[name]}"
    assert not re.search(r"\b(pseudo|residual|operator|transmissibility|noncausal|axes)\b", first)


@pytest.mark.nightly
def test_the_examples_run(tmp_path, monkeypatch, capsys):
    assert {*CHAIN} | ELSEWHERE | LONG == {*COMMANDS}
    settings = [(0.0, "SIM_GYR1_BIAS_Y", 0.0), (90.0, "SIM_GYR1_BIAS_Y", 0.08)]
    flown = broken(gb.Bias(channel="q", onset_s=90.0, size=4.58))
    (tmp_path / "flight.bin").write_bytes(ardupilot(flown, settings=settings))
    shutil.copy(ROOT / "gtmbench/baselines/bank-C.json", tmp_path / "monitor.json")  # export's: of many flights
    codes = {EXAMPLES["score"]: 1}
    cheap = {EXAMPLES["run"]: "--no-figures"}
    run_chain([EXAMPLES[name] for name in CHAIN], tmp_path, monkeypatch, capsys, codes=codes, cheap=cheap)


def test_the_others_are_the_readmes():
    assert {EXAMPLES[name] for name in ELSEWHERE} <= set(commands(ROOT / "README.md"))


@pytest.mark.parametrize("name", OLD)
def test_an_old_name_prints_the_new_one_whose_options_are_there(name, cli):
    assert refused(cli(name, "what", "--ever")).startswith(f"gtmbench: gtmbench {name} has moved: gtmbench ")
    for line in re.findall(r"gtmbench [a-z].*?(?=;|$)", moved_command([name]).partition(": ")[2]):
        new, *words = line.split()[1:]
        known = {option for parameter in COMMANDS[new].params for option in parameter.opts}
        assert [word for word in words if word.startswith("--") and word not in known] == []
