"""Paths and names that aren't meant well: pipes, devices, circles, and what climbs, writes outside or commands."""

import ast
import os
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.testing import shared_flights
from tests.helpers.hostile import refused, unchanged
from tests.helpers.night import by_day

PACKAGE = Path(gb.__file__).parent
GIB = 1 << 30


@pytest.fixture(autouse=True)
def _not_for_ever():
    """A pipe that is opened, or a device that is read, blocks: end the test instead."""

    def give_up(*_):
        raise AssertionError("this took more than 60 s")

    former = signal.signal(signal.SIGALRM, give_up)
    signal.alarm(60)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, former)


def bound(path):
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(path))


MADE = {
    "a pipe": os.mkfifo,
    "a folder": Path.mkdir,
    "a socket": bound,
    "a link to nothing": lambda path: path.symlink_to("nowhere/x"),
    "a link to itself": lambda path: path.symlink_to(path.name),
    "endless zeros": lambda path: path.symlink_to("/dev/zero"),
    "nothing": Path.touch,
    "10 GiB": lambda path: (path.touch(), os.truncate(path, 10 * GIB)),
    "zeros": lambda path: path.write_bytes(bytes(5000)),
    "commands for a terminal": lambda path: path.write_bytes(b"\x1b[2J\x1b]0;x\x07 = \x9b[\n\r\n" * 9),
}
NAMES = {"a plain name": "given", "a name of commands": "\x1b[2J\n\u202e[red]", "a name that isn't UTF-8": "m\udce4rz"}
READING = {
    ".json": [["list", "{}"], ["run", "drift", "--detector", "{}"], ["monitor", "log.csv", "--detector", "{}"]],
    ".rrd": [["verify", "{}", "--against", "{}"]],
    ".csv": [
        ["calibrate", "{}", "--detector", "paper"],
        ["monitor", "{}", "--detector", "paper"],
        ["monitor", "log.csv", "--detector", "paper", "--healthy", "{}"],
    ],
    ".parquet": [["calibrate", "{}", "--detector", "paper"], ["monitor", "{}", "--detector", "C"]],
    ".ulg": [["monitor", "{}", "--detector", "C"]],
    ".bin": [["monitor", "{}", "--detector", "C"]],
    ".mcap": [["monitor", "{}", "--detector", "C"]],
    ".toml": [
        ["run", "{}"],
        ["list", "{}"],
        ["check", "{}"],
        ["check", "{}", "--update"],
        ["check", "new.toml", "--update", "--scenario", "{}"],
        ["run", "drift", "--detector", "{}"],
        ["calibrate", "--detector", "{}"],
    ],
}


def log(path, samples=1500):
    noise = np.random.default_rng(3).standard_normal((samples, 4))
    gb.write_log(gb.Record(noise, channels=["p", "q", "r", "beta"], sample_period_s=0.02), path)


@pytest.mark.parametrize("ending", by_day(READING))
def test_whatever_stands_in_a_files_place_is_refused(cli, tmp_path, record_property, ending):
    log("log.csv")
    tried = 0
    names = [*NAMES.values()]
    for k, make in enumerate(MADE.values()):
        for j, command in enumerate(READING[ending]):
            given = Path(f"{names[(j + k) % len(names)]}{ending}")  # each command hears each name, each place has each
            make(given)
            with unchanged(tmp_path):
                refused(cli(*(str(given) if word == "{}" else word for word in command)))
            given.rmdir() if given.is_dir() and not given.is_symlink() else given.unlink()
            tried += 1
    record_property("inputs", tried)
    print(f"{tried} inputs, all refused")


@pytest.mark.parametrize("name", by_day(["x" * 300, "none", "../" * 50 + "etc/passwd", "/proc/self/mem", "."], 3))
@pytest.mark.parametrize("ending", by_day(READING, 2))
def test_paths_that_are_no_files_are_refused(cli, tmp_path, name, ending):
    log("log.csv")
    for command in READING[ending]:
        if name != "none" or "--update" not in command[:3]:
            given = name if name[0] in "./" else f"{name}{ending}"
            with unchanged(tmp_path):
                refused(cli(*(given if word == "{}" else word for word in command)))


WRITING = {
    ".csv": ["fly", "--duration", "1", "--force", "--out"],
    ".parquet": ["fly", "--duration", "1", "--force", "--out"],
    ".toml": ["run", "--new"],
    ".json": ["calibrate", "log.csv", "--detector", "paper", "--force", "--out"],
    ".png": ["monitor", "log.csv", "--force", "--report"],
    ".rrd": ["monitor", "log.csv", "--force", "--record"],
    ".xml": ["check", "--junit"],
}


@pytest.mark.parametrize("ending", by_day(WRITING, 2))
def test_nothing_but_a_file_is_written_over(cli, tmp_path, ending):
    log("log.csv")
    device = Path("/dev/full").lstat()
    (tmp_path / f"full{ending}").symlink_to("/dev/full")
    os.mkfifo(f"pipe{ending}")
    bound(f"socket{ending}")
    Path(f"folder{ending}").mkdir()
    Path(f"circle{ending}").symlink_to(f"circle{ending}")
    for name in ("full", "pipe", "socket", "folder", "circle", "nowhere/x", "m\udce4rz", "x" * 300):
        with unchanged(tmp_path):
            refused(cli(*WRITING[ending], f"{name}{ending}"))
    assert Path("/dev/full").lstat().st_mode == device.st_mode


@pytest.mark.parametrize("name", ["pipe", "file", "circle"])
def test_results_are_written_into_folders_only(cli, tmp_path, name):
    os.mkfifo("pipe")
    Path("file").touch()
    Path("circle").symlink_to("circle")
    with unchanged(tmp_path):
        refused(cli("run", "drift", "--force", "--out", name))


@pytest.mark.parametrize("junit", ["mine.toml", "report.txt", "report"])
def test_a_junit_file_never_replaces_a_baseline(cli, tmp_path, junit):
    shutil.copy(PACKAGE / "baselines/dissertation.toml", "mine.toml")
    with unchanged(tmp_path):
        refused(cli("check", "mine.toml", "--junit", junit))


@pytest.fixture
def model(copied_gtm):
    """Change a copy of the GTM; return its folder."""

    def changed(old="", new="", *, part="mine.xml", count=1):
        folder = copied_gtm("mine")
        text = (folder / part).read_text()
        assert old in text
        (folder / part).write_text(text.replace(old, new, count))
        return folder

    return changed


OUTSIDE = {
    "a file is written": '<output name="/tmp/gtmbench-was-here.csv" type="CSV" rate="1"><rates>ON</rates></output>',
    "a host is told": '<output name="127.0.0.1" type="SOCKET" port="5139" rate="1"/>',
    "a port is opened": '<input type="SOCKET" port="5139" protocol="TCP"/>',
    "a file is read": '<system file="../../../../etc/passwd"/>',
    "another is read": '<system file="/etc/passwd"/>',
    "elements in elements": "<a>" * 50_000 + "</a>" * 50_000,
    "no end": "<a>",
}


@pytest.mark.parametrize("section", OUTSIDE)
def test_a_model_that_reaches_outside_is_refused(cli, tmp_path, model, section):
    folder = model("</fdm_config>", OUTSIDE[section] + "</fdm_config>")
    with unchanged(tmp_path):
        refused(cli("aircraft", folder))
    assert not Path("/tmp/gtmbench-was-here.csv").exists()


def test_a_model_of_entities_is_refused(cli, model):
    laughs = "".join(f'<!ENTITY a{i + 1} "{f"&a{i};" * 10}">' for i in range(9))
    folder = model("<fdm_config", f'<!DOCTYPE x [<!ENTITY a0 "ha">{laughs}]>\n<fdm_config')
    refused(cli("aircraft", folder))


@pytest.mark.parametrize("make", ["a pipe", "a link to itself", "endless zeros", "10 GiB", "nothing"])
@pytest.mark.parametrize("part", ["aircraft.toml", "mine.xml", "gtm-tables.xml"])
def test_an_aircraft_of_other_than_files_is_refused(cli, model, make, part):
    folder = model()
    (folder / part).unlink()
    MADE[make](folder / part)
    refused(cli("aircraft", folder))


def test_a_model_that_cant_be_flown_doesnt_end_the_process(model):
    """JSBSim's engine throws from its destructor then, in whichever process that is."""
    folder = model("<property>metrics/bw-ft</property>", "<property>metrics/never-heard-of</property>")
    command = [sys.executable, "-m", "gtmbench", "aircraft", folder]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    refused((ended.returncode, ended.stdout, ended.stderr))
    assert "JSBSim can't fly 'mine'" in ended.stderr


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("altitude_ft = 8000", "altitude_ft = 1e400"),
        ("altitude_ft = 8000", f"altitude_ft = 1{'0' * 400}"),
        ("psi_deg = ", "psi_deg = nan # "),
        ("rudder = [-30.0, 30.0]", "rudder = [30.0, -30.0]"),
        ("rudder = [-30.0, 30.0]", "rudder = [-inf, inf]"),
        ("throttle = 20.0", "throttle = 2000.0"),
        ("title = ", "title = 5 #"),
        ("[trim]", "trim = 5\n[x]"),
    ],
)
def test_figures_of_an_aircraft_that_nobody_means_are_refused(cli, model, old, new):
    refused(cli("aircraft", model(old, new, part="aircraft.toml")))


QUICK = """
duration_s = 40.0
excitation = "multisine"
severity_reference_s = [1.0, 20.0]
operator = { identify_s = [1.0, 15.0], causal_order = 5, noncausal_order = 5 }
alarm = { window = 50, threshold_s = [15.0, 35.0], watch_from_s = 5.0, healthy_records = 1 }
faults = [{ kind = "drift", channels = ["p"], onset_s = 20.0, slope = 3.0 }]
"""


@pytest.mark.nightly
def test_a_scenario_may_be_called_anything_that_can_be_printed(cli, tmp_path):
    names = ["$\\frac$", "..", "[red] {a} %s"]
    for name in names:
        Path(f"{name}.toml").write_text(QUICK)
    code, _, err = cli("run", *(f"./{name}.toml" for name in names), "--out", "found")
    assert (code, err) == (0, "")
    written = {"SHA256SUMS", "markov.png", "prediction.png", "results.json", "study.rrd", "trials.csv"}
    assert {path.name for path in Path("found").iterdir()} == written | {f"norm_{name}.png" for name in names}
    assert {path.name for path in tmp_path.iterdir()} == {"found", *(f"{name}.toml" for name in names)}


@pytest.mark.parametrize("name", ["\x1b[2J", "a\nb", "m\udce4rz", "x" * 220])
def test_scenarios_and_banks_of_names_that_cant_be_printed_are_refused(cli, name):
    Path(f"{name}.toml").write_text(QUICK)
    refused(cli("run", f"{name}.toml"))
    shutil.copy(PACKAGE / "banks/C.toml", f"{name}.toml")
    refused(cli("list", f"{name}.toml"))


@pytest.mark.parametrize("name", by_day(["a\x1b[2Jb\nc.csv", "m\udce4rz.csv"]))
def test_a_logs_name_commands_no_terminal(cli, tmp_path, name):
    log(tmp_path / "log.csv", 3000)  # of half a minute, thresholds are blind, and no monitor is saved
    (tmp_path / "log.csv").rename(name)
    own = ["--healthy", "0:40", "--inputs", "p", "--outputs", "q", "--look", "0.05", "--out", "o.json"]
    assert cli("calibrate", name, *own)[0] == 0
    code, text, err = cli("monitor", name, "--detector", "o.json", "--record", "o.rrd", "--report", "o.png")
    assert code in (0, 1, 3)  # it was read, whatever it comes to
    assert err == ""
    assert all(line.isprintable() for line in text.split("\n"))
    assert cli("list", "o.json")[0] == 0


def test_a_baselines_name_adds_no_setting(cli):
    Path("s.toml").write_text(QUICK)
    assert cli("check", "a\nseed = 7\n#.toml", "--update", "--scenario", "s.toml", "-q") == (0, "", "")
    assert "seed = 7" not in Path("a\nseed = 7\n#.toml").read_text().splitlines()


def test_a_flight_that_holds_pickled_objects_is_refused(tmp_path):
    class Evil:
        def __reduce__(self):
            return (os.mkdir, (str(tmp_path / "ran"),))

    np.savez(tmp_path / "flight.npz", values=np.array([Evil()], dtype=object), channels=["p"], times_s=[0.01])
    with pytest.raises(ValueError, match="allow_pickle"):
        shared_flights._record_from(tmp_path / "flight.npz")
    assert not (tmp_path / "ran").exists()


@pytest.mark.nightly
def test_no_module_runs_what_it_reads():
    """No pickle, no eval, no shell; and modules are imported by names of our own."""
    forbidden = {"pickle", "cPickle", "dill", "cloudpickle", "joblib", "shelve", "marshal", "yaml", "torch"}
    calls = {"eval", "exec", "compile", "__import__", "read_pickle", "system", "popen", "execfile", "getoutput"}
    own = {  # they pickle objects that are there, and read no file
        PACKAGE / "testing/contract/suite.py",
        PACKAGE / "jobs/workers.py",  # for other processes, as a pool would, after the user's imports
        PACKAGE / "log/fleet.py",  # for workers of a cluster, in the same way
    }
    modules = sorted(set(PACKAGE.rglob("*.py")) - own)
    assert len(modules) > 100
    for path in modules:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import | ast.ImportFrom):
                names = [alias.name for alias in node.names] + [getattr(node, "module", None) or ""]
                assert not {name.split(".")[0] for name in names} & forbidden, path
            if isinstance(node, ast.Call):
                name = getattr(node.func, "id", getattr(node.func, "attr", ""))
                owner = getattr(getattr(node.func, "value", None), "id", "")
                assert name not in calls or (owner, name) == ("re", "compile"), (path, name)
                given = {word.arg: getattr(word.value, "value", ...) for word in node.keywords}
                assert given.get("shell", False) is False, path
                assert given.get("allow_pickle", False) is False, path
