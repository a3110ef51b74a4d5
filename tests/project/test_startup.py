"""Text is printed at once: no command imports, for its help or the list of names, what it would take to work."""

import json
import subprocess
import sys

import pytest

import gtmbench as gb
from gtmbench.bench.excitation import EXCITATIONS
from gtmbench.cli.calibrate import calibrate_command
from gtmbench.cli.listing import listing
from gtmbench.cli.output import told_names
from gtmbench.detectors.registry import detector_names
from gtmbench.faults.registry import FAULTS
from gtmbench.method.pseudo_inputs import PSEUDO_INPUTS
from gtmbench.study.healthy_records import CalibrationFlights
from gtmbench.values.channels import ATTITUDE, GYROS
from tests.helpers import monitors
from tests.helpers.commands import COMMANDS

HEAVY = "numpy", "scipy", "pandas", "pyarrow", "rerun", "jsbsim", "matplotlib", "rich", "asyncio", "multiprocessing"
PROBE = """
import json, sys
from gtmbench.cli.app import main
for line in json.loads(sys.argv[1]):
    try:
        main(line)
    except SystemExit as ended:
        print(json.dumps([line, ended.code, sorted(sys.modules)]), file=sys.stderr)
"""


def loaded_by(*lines):
    """Return of command lines, one after the other in one process, how each ended and what is loaded by then."""
    ended = subprocess.run([sys.executable, "-c", PROBE, json.dumps(lines)], capture_output=True, text=True, check=True)
    return [json.loads(told) for told in ended.stderr.splitlines() if told.startswith("[")]


def loaded_after(code):
    """Return what is loaded in a process that has run some Python."""
    probe = [sys.executable, "-c", f"import sys; {code}; print(*sorted(sys.modules))"]
    return subprocess.run(probe, capture_output=True, text=True, check=True).stdout.split()


def heavy(modules):
    return {name.partition(".")[0] for name in modules} & set(HEAVY)


def test_texts_are_printed_without_anything_heavy():
    lines = [["--help"], ["--version"], ["list"], *([name, "--help"] for name in COMMANDS)]
    told = loaded_by(*lines)
    assert [line for line, _, _ in told] == lines
    for line, code, modules in told:
        assert (code, heavy(modules)) == (0, set()), line


@pytest.mark.parametrize(
    ("code", "meant"),
    [
        ("import gtmbench", set()),
        ("import gtmbench.pytest_plugin", set()),
        ("import gtmbench as gb; dir(gb); gb.Drift", {"numpy"}),
        ("from gtmbench.api import *", {"asyncio", "jsbsim", "multiprocessing", "numpy"}),
    ],
)
def test_what_is_imported_loads_nothing_heavy_but_what_it_needs(code, meant):
    modules = loaded_after(code)
    assert heavy(modules) == meant
    if code == "import gtmbench":
        assert [name for name in modules if name.startswith("gtmbench")] == ["gtmbench", "gtmbench.version"]
    assert "gtmbench.study" not in modules or "api" in code


@pytest.mark.nightly
def test_a_watched_log_loads_what_watching_takes(tmp_path):
    """Of what is heavy; scipy.signal and scipy.stats alone would take half a second."""
    log = tmp_path / "flight.csv"
    gb.write_log(monitors.record(2000, seed=5).select(GYROS + ATTITUDE), log)
    ((_, code, modules),) = loaded_by(["monitor", str(log)])
    assert (code in (0, 1, 3), heavy(modules)) == (True, {"numpy", "pandas", "pyarrow", "rich", "scipy"})
    unneeded = (
        "detectors.rivals",
        "detectors.surfaces",
        "engine.course",
        "engine.commands",
        "history",
        "log.truth",
        "study",
    )
    assert [name for name in modules if name.startswith(tuple(f"gtmbench.{room}" for room in unneeded))] == []
    assert not {"scipy.signal", "scipy.stats", "scipy.optimize", "scipy.interpolate", "scipy.ndimage"} & {*modules}


def first_lines(objects):
    return {name: of.__doc__.strip().splitlines()[0].replace("``", "") for name, of in objects.items()}


def test_help_lists_what_commands_say_and_imports_none():
    meant = {name: command.get_short_help_str(limit=200) for name, command in COMMANDS.items()}
    wanted = "\n".join(f"{name} = {json.dumps(line, ensure_ascii=False)}" for name, line in meant.items())
    assert told_names()["commands"] == meant, f"gtmbench/cli/names.toml, [commands]:\n{wanted}"
    loaded = loaded_after("from gtmbench.cli.app import app; app(['--help'], standalone_mode=False)")
    assert not {f"gtmbench.cli.{name}" for name in ("monitor", "study", "listing")} & {*loaded}


@pytest.mark.parametrize(
    ("section", "meant"),
    [
        ("excitations", first_lines(EXCITATIONS)),
        ("faults", first_lines(FAULTS)),
        ("detectors", detector_names()),
        ("pseudo_inputs", {item.name: f"{item.unit}, {item.formula}" for item in PSEUDO_INPUTS.values()}),
    ],
)
def test_the_list_says_what_python_says(section, meant):
    told = listing()[section]
    wanted = "\n".join(f"{name} = {json.dumps(line, ensure_ascii=False)}" for name, line in meant.items())
    assert told == meant, f"gtmbench/cli/names.toml, [{section.replace(' ', '_')}]:\n{wanted}"
    assert list(told) == list(meant)


def test_the_help_of_calibrate_states_its_defaults():
    flights = CalibrationFlights()
    stated = {
        "flights": flights.flights,
        "duration_s": flights.duration_s,
        "excitation": flights.excitation,
        "aircraft": flights.aircraft,
    }
    helps = {option.name: getattr(option, "help", "") for option in calibrate_command.params}
    for name, value in stated.items():
        assert helps[name].endswith(
            f"[default: {value:g}]" if isinstance(value, float | int) else f"[default: {value}]"
        )
