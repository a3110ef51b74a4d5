"""The pages under docs/ tell the truth: their Python runs, their commands are commands, their example is the file."""

import re
import runpy
import shlex
import sys
from dataclasses import fields
from types import ModuleType

import pytest

from gtmbench import fly_in_loop
from gtmbench.detectors.isolation.hypotheses import families
from gtmbench.faults import registry as kinds_of_faults
from gtmbench.faults.fault import Fault
from gtmbench.faults.parameter import Intermittent
from gtmbench.faults.registry import FAULTS
from gtmbench.intake.formats import registry as formats
from gtmbench.study.fault_tables import Expectation
from gtmbench.study.scenario import AlarmSetup, OperatorSetup, Setup, load_faults, load_scenario
from gtmbench.study.score import SAME_KINDS
from tests.helpers.commands import COMMANDS
from tests.helpers.pages import ROOT, blocks, commands, run_chain

PAGES = [page for page in sorted((ROOT / "docs").rglob("*.md")) if "generated" not in page.parts]
OF_ROOT = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")]


SCRIPTS = [page for page in PAGES if blocks(page, "python")]


@pytest.mark.nightly
@pytest.mark.parametrize("page", SCRIPTS, ids=lambda page: page.stem)
def test_its_python_runs(page, tmp_path, monkeypatch, capsys):
    """As a module of its own, in this process, which has imported what takes long and finds `experiments/`."""
    module = ModuleType(f"page_{page.stem}")
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr(kinds_of_faults, "_registered", {})
    monkeypatch.setattr(formats, "FORMATS", formats.FORMATS)
    monkeypatch.chdir(tmp_path)
    exec(compile("\n".join(blocks(page, "python")), page.name, "exec"), vars(module))
    out, err = capsys.readouterr()
    assert err == ""
    if page.stem == "identify":
        assert "[p q beta] -> r (101, 1, 3)" in out
        alarms = re.findall(r"^(?:alarm at )?\[(\d+\.\d+)", out, flags=re.MULTILINE)
        assert len(alarms) > 1
        assert alarms[0] == alarms[1], "the stream's first alarm is the batch's"
    if page.stem == "detectors":
        assert re.search(r"^0 \d+\.\d+ q alarm$", out, flags=re.MULTILINE)


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "sh")], ids=lambda page: page.stem)
def test_its_commands_parse(page):
    for line in "".join(blocks(page, "sh")).splitlines():
        program, command, *arguments = shlex.split(line, comments=True)
        assert program == "gtmbench"
        COMMANDS[command].make_context(command, arguments)


CHEAP = {  # what is added to a command; `test_wheel` runs the whole study
    "gtmbench run": "jam --no-figures",
    "gtmbench run drift jam": "--no-figures --no-recording",
    "gtmbench run jam": "--no-figures",
}


@pytest.mark.nightly
@pytest.mark.parametrize(
    "names", [("tutorial/first_flight", "how_to/my_log"), ("reference/cli",)], ids=lambda names: names[0]
)
def test_the_commands_run_as_one_chain(names, tmp_path, monkeypatch, capsys):
    pages = [ROOT / f"docs/{name}.md" for name in names]
    for page in pages:
        for content in blocks(page, "toml"):
            (tmp_path / content.split("\n")[0].removeprefix("# ")).write_text(content)
    elsewhere = (
        "gyro_x",
        "gtmbench demo",
        "gtmbench fly --rescue",
        "gtmbench calibrate --out",
        "gtmbench check",
        "gtmbench export",
        "gtmbench run drift jam",
    )  # no such column; run elsewhere
    chain = [line for page in pages for line in commands(page) if not any(part in line for part in elsewhere)]
    assert len(chain) > 10
    codes = {"gtmbench monitor broken.csv --healthy 0:25 --report broken.png": 1}
    printed = " ".join(run_chain(chain, tmp_path, monkeypatch, capsys, cheap=CHEAP, codes=codes).split())
    verdicts = [block for page in pages for block in blocks(page, "text") if "what would show, or why not" in block]
    assert len(verdicts) == (2 if names[0] == "tutorial/first_flight" else 0)
    for line in (line for verdict in verdicts for line in verdict.splitlines()):  # of a narrow screen, which cuts cells
        assert " ".join(line.partition("...")[0].split()) in printed


@pytest.mark.nightly
def test_the_scenarios_of_the_page_are_files_that_its_commands_run(cli, tmp_path, monkeypatch):
    """One chain: every command ends as its remark says, with what those before it wrote."""
    monkeypatch.setattr("gtmbench.study.watchers.FLIGHTS", 3)
    page = ROOT / "docs/how_to/scenarios.md"
    for content in blocks(page, "toml"):
        (tmp_path / content.split("\n")[0].removeprefix("# ")).write_text(content)
        assert len(load_faults(tmp_path / content.split("\n")[0].removeprefix("# "))) > 0
    assert [len(load_scenario(tmp_path / f"{name}.toml").faults) for name in ("gusts", "chain")] == [5, 2]
    chain = "".join(blocks(page, "sh")).splitlines()
    assert len(chain) == 6
    for line in chain:
        _, command, *arguments = shlex.split(line, comments=True)
        cheap = ["--no-figures", "--no-recording"] if command == "run" else []
        code, out, err = cli(command, *arguments, *cheap)
        assert (code, err) == (int(command == "monitor"), ""), line
        if command == "monitor":
            assert "pitch gyro (q) failed from 4" in out
            assert "yaw gyro (r) failed from 5" in out
        if "--strict" in line:
            assert "expectations met: 5 of 5" in out


def test_every_key_of_a_fault_and_of_what_is_expected_stands_in_the_page():
    told = set(re.findall(r"`(\w+)", (ROOT / "docs/how_to/scenarios.md").read_text()))
    text = (ROOT / "docs/how_to/scenarios.md").read_text()
    common = {item.name for item in fields(Fault)} - {"channel"}
    assert common | {"kind", "channels", "end_s", "unit"} | {item.name for item in fields(Expectation)} <= told
    assert all(f"{item.name} =" in text for item in fields(Intermittent))


@pytest.mark.parametrize(("name", "page", "most"), [("limit_check", "detectors", 25), ("pid", "controllers", 36)])
def test_an_example_is_the_file_and_short(name, page, most):
    example = (ROOT / f"docs/how_to/examples/{name}.py").read_text()
    assert example == blocks(ROOT / f"docs/how_to/{page}.md", "python")[0]
    assert len(example.splitlines()) <= most


def test_the_regulator_of_the_examples_flies():
    regulator = runpy.run_path(str(ROOT / "docs/how_to/examples/lqr.py"))["Lqr"]
    assert fly_in_loop(duration_s=20.0, seed=2, controller=regulator).departed_s is None


def test_links_lead_somewhere():
    for page in (*PAGES, *OF_ROOT):
        for target in re.findall(r"\]\(([^)#]+\.md)(?:#[^)]*)?\)", page.read_text()):
            assert (page.parent / target).is_file(), target


def test_files_that_are_named_exist():
    """Whole paths anywhere; in the table of rooms, what to begin with stands below its room."""
    every = set()
    for page in (*PAGES, *OF_ROOT):
        text = page.read_text()
        named = set(re.findall(r"`((?:gtmbench|aircraft|docs|experiments|faults|tests)/[\w./-]+)`", text)) - {
            "aircraft/NAME/",
            "faults/KIND.toml",
            "gtmbench/GTM-v0",  # the environment's name
        }
        for room, first in re.findall(r"^\| `(gtmbench/\w+/)`[^|]*\|[^|]*\| (`[^|]*`) \|$", text, flags=re.MULTILINE):
            named |= {room + name for name in re.findall(r"`([\w./]+)`", first)}
        assert [name for name in named if not (ROOT / name).exists()] == []
        every |= named
    assert len(every) > 50


def test_what_contributing_says_to_run_is_there():
    words = " ".join(blocks(OF_ROOT[1], "sh")).split()
    tried = [word for word in words if word.startswith(("tests/", "gtmbench/"))]
    assert len(tried) > 10
    assert [word for word in tried if not (ROOT / word).exists()] == []


def test_every_room_stands_in_the_design():
    text = (ROOT / "docs/explanation/design.md").read_text()
    rooms = [path.parent for path in (ROOT / "gtmbench").glob("*/__init__.py")]
    assert len(rooms) > 9
    for room in rooms:
        assert re.search(rf"^\| `gtmbench/{room.name}/`", text, flags=re.MULTILINE), room.name
        inner = [path.parent.name for path in room.glob("*/__init__.py")]
        line = re.search(rf"^\| `gtmbench/{room.name}/`.*$", text, flags=re.MULTILINE)[0]
        assert [name for name in inner if f"{name}/`" not in line] == []


def test_every_kind_of_fault_stands_in_its_page_with_its_parameters():
    rows = re.findall(
        r"^\| `(\w+)` \|.*?\|(.*)\|.*\|$", (ROOT / "docs/reference/faults.md").read_text(), flags=re.MULTILINE
    )
    told = {kind: set(re.findall(r"`(\w+)`", parameters)) for kind, parameters in rows if kind in FAULTS}
    assert told == {kind: {item.name for item in cls.parameters()} for kind, cls in FAULTS.items()}


def test_every_family_of_hypotheses_stands_in_its_page_and_every_kind_is_spoken_of():
    text = (ROOT / "docs/explanation/diagnosis.md").read_text()
    rows = re.findall(r"^\| `([\w-]+)` \| ([\w, ]+) \|", text, flags=re.MULTILINE)
    assert sorted(family for family, _ in rows) == sorted(families())
    told = {kind for _, kinds in rows for kind in kinds.split(", ")}
    assert told | {"dropout", "float"} == set(FAULTS)  # nothing to explain; of surfaces


def test_kinds_that_count_as_the_same_stand_in_the_page():
    text = (ROOT / "docs/explanation/diagnosis.md").read_text()
    assert re.findall(r"^\| `(\w+)` \| `(\w+)` \|", text, flags=re.MULTILINE) == list(SAME_KINDS)


def test_every_scenario_key_stands_in_its_table():
    keys = {item.name for item in fields(Setup)} - {"operator", "alarm"}
    keys |= {item.name for table in (OperatorSetup, AlarmSetup) for item in fields(table)}
    keys |= {parameter.name for kind in FAULTS.values() for parameter in kind.parameters()}
    table = (ROOT / "docs/reference/scenario_keys.md").read_text()
    for key in keys:
        assert re.search(rf"[`.]{key}`", table), key


def test_nobody_is_told_to_install_a_package_that_no_registry_has():
    for page in (*PAGES, *OF_ROOT, *(ROOT / "gtmbench").rglob("*.py")):
        assert "pip install gtmbench" not in page.read_text(encoding="utf-8"), page
