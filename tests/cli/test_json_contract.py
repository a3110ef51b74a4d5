"""What `--json` prints keeps the contract of docs/reference/json.md: real outputs, by their schemas."""

import json
import shutil
from functools import cache
from importlib import import_module
from importlib.resources import files

import pytest
from jsonschema import Draft202012Validator

import gtmbench as gb
from gtmbench.bench import tuning
from gtmbench.check.baseline import new_baseline, write_figures
from gtmbench.check.figures import figures_of
from gtmbench.cli import demo
from gtmbench.files.plain import SCHEMA_VERSION
from gtmbench.report.recording.write import write_recording
from gtmbench.study.benchmark import definition
from gtmbench.study.benchmark.definition import load_definition
from tests.check import test_check
from tests.cli.test_cli import SHORT
from tests.helpers import monitors
from tests.helpers.autopilot_logs import ardupilot, broken
from tests.helpers.campaigns import TINY
from tests.helpers.commands import COMMANDS
from tests.helpers.night import by_day
from tests.helpers.rescuing import early_monitor
from tests.helpers.sealed import rerecorded
from tests.helpers.small_benchmark import finds, tiny, write_scores

FIRST = ["verdict", "exit_code", "findings", "schema_version", "command"]
ALONE = "--no-figures --no-recording --force"
FAILED, BAD, UNKNOWN = 1, 2, 3
# by name: its schema, the exit code, the command line
CASES = {
    "aircraft": ("aircraft", 0, "aircraft --modes"),
    "aircraft, its gains": ("aircraft-autopilot", 0, "aircraft A320 --autopilot"),
    "aircraft, its facts": ("aircraft-facts", 0, "aircraft gtm --facts --out facts"),
    "export": ("export", 0, "export ready.json --out on_board --force"),
    "benchmark": ("benchmark", 0, "benchmark --score entry --out table --jobs 1"),
    "benchmark, written": ("benchmark-export", 0, "benchmark --export flights --jobs 1"),
    "calibrate": ("calibrate", 0, "calibrate healthy.csv --out m.json --force"),
    "campaign": ("campaign", 0, "campaign tiny.toml --out c --jobs 1 --resume"),
    "campaign, planned": ("campaign-plan", 0, "campaign tiny.toml --dry-run"),
    "campaign, a share": ("campaign-shard", 0, "campaign tiny.toml --out share --jobs 1 --shard 1/2 --resume"),
    "check, passed": ("check", 0, "check checked/mine.toml"),
    "check, failed": ("check", FAILED, "check checked/spoilt.toml"),
    "check, made": ("check-update", 0, "check checked/new.toml --update --scenario checked/short.toml"),
    "check, renewed": ("check-update", 0, "check checked/renewed.toml --update"),
    "demo": ("demo", 0, "demo --out d --force"),
    "fly": ("fly", 0, "fly --out f.csv --duration 2 --noise t2 --force"),
    "fly, and depart": ("fly", 0, "fly --out f.csv --closed-loop --duration 8 --fault flip.toml --trial 1 --force"),
    "inject": ("inject", 0, "inject healthy.csv --fault flip.toml --out b.csv --force"),
    "inject, listed": ("inject-list", 0, "inject healthy.csv --fault flip.toml --list"),
    "list": ("list", 0, "list --all"),
    "list, a bank": ("list-bank", 0, "list C"),
    "list, a monitor": ("list-bank", 0, "list ready.json"),
    "monitor, healthy": ("monitor", 0, "monitor healthy.csv --detector ready.json"),
    "monitor, failed": ("monitor", FAILED, "monitor broken.csv --detector ready.json"),
    "monitor, cannot tell": ("monitor", UNKNOWN, "monitor turned.csv --detector ready.json"),
    "monitor, by itself": ("monitor", 0, "monitor healthy.csv"),
    "calibrate, own relation": (
        *("calibrate", 0),
        "calibrate healthy.csv --inputs p_att --outputs p --healthy 0:25 --out own.json --force",
    ),
    "monitor, listed": ("monitor-list", 0, "monitor healthy.csv --list"),
    "monitor, a history": (
        "monitor-history",
        UNKNOWN,
        "monitor healthy.csv turned.csv --detector ready.json --history h.parquet",
    ),
    "monitor, a fleet": ("monitor-fleet", FAILED, "monitor logs --detector ready.json --out o --resume"),
    "live, healthy": ("live", 0, "live healthy.tlog --detector ready.json"),
    "live, failed": ("live", FAILED, "live broken.tlog --detector ready.json"),
    "live, cannot tell": ("live", UNKNOWN, "live short.tlog --detector ready.json"),
    "live, an event": ("live-event", FAILED, "live broken.tlog --detector ready.json"),
    "campaign, reported": ("campaign-report", 0, "campaign c --report html"),
    "fly, rescued": ("fly-rescue", 0, "fly --rescue --detector early.json --out r.rrd --force"),
    "run, a new scenario": ("run-new", 0, "run --new x.toml"),
    "run": ("run", 0, f"run short.toml {ALONE}"),
    "run, by a bank": ("run", 0, f"run short.toml {ALONE} --detector early.json"),
    "run, otherwise": ("run", FAILED, f"run strict.toml {ALONE} --strict"),
    "run, seeds": ("run-seeds", 0, "run short.toml --no-figures --no-recording --out seeds --seed 1:2"),
    "score": ("score", FAILED, "score biased.bin --detector C"),
    "verify": ("verify", 0, "verify ready.json checked/mine.toml"),
    "verify, altered": ("verify", FAILED, "verify ready.json altered.json"),
    "verify, equal": ("verify-against", 0, "verify 1.rrd --against 1.rrd"),
    "verify, different": ("verify-against", FAILED, "verify 1.rrd --against 2.rrd"),
    "view": ("view", 0, "view 1.rrd --web"),
    "bad input": ("error", BAD, "monitor nowhere.csv --detector C"),
    "bad option": ("error", BAD, "run --speed"),
}
# what a second run of a command line has from the first
WORKED_OUT = (
    "gtmbench.log.watch.watch_log",
    "gtmbench.log.truth.score.score_log",
    "gtmbench.study.run.run_study",
    "gtmbench.study.run.fly_rescue",
)
FLIP = """
[[faults]]
kind = "sign_flip"
channels = ["q"]
onset_s = 5.0
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """What the command lines are given: logs, scenarios, monitors, recordings, baselines."""
    made = tmp_path_factory.mktemp("contract")
    (made / "logs").mkdir()
    healthy = monitors.record(2500, seed=11)
    logs = {
        "healthy": healthy,
        "broken": gb.inject(healthy, gb.Bias(channel="q", onset_s=30.0, size=8.0)),
        "turned": healthy.replace("q", -healthy["q"]),
    }
    for name, record in logs.items():
        gb.write_log(record, made / f"{name}.csv")
    for name, seconds in (("healthy", 49.0), ("broken", 49.0), ("short", 5.0)):
        gb.send_live(logs[name if name in logs else "healthy"].between(0.0, seconds), made / f"{name}.tlog")
    shutil.copy(made / "broken.csv", made / "logs")
    (made / "logs/none.csv").write_text("no table\n")
    gb.save_monitor(monitors.monitor(), made / "ready.json")
    tiny(made, "frozen")
    strict = f"{SHORT}[faults.expect.dissertation]\ndetect_within_s = 0.001\n"
    for name, text in {"tiny": TINY.replace("1:8", "1:2"), "short": SHORT, "strict": strict, "flip": FLIP}.items():
        (made / f"{name}.toml").write_text(text)
    baseline, checked = made / "checked/mine.toml", made / "checked/short.toml"
    checked.parent.mkdir()
    checked.write_text(test_check.SHORT)
    write_figures(baseline, new_baseline(baseline, scenarios=[str(checked)], detector=None), seed=1, groups=groups())
    for name in ("spoilt", "renewed"):
        spoilt = baseline.read_text().replace("detected = false", "detected = true")
        baseline.with_stem(name).write_text(rerecorded(spoilt))
    document = json.loads((made / "ready.json").read_text())
    (made / "altered.json").write_text(json.dumps(document | {"detector": "B"}))
    return made


def _recorded(folder, seed):
    return write_recording(gb.run_study([gb.load_scenario(folder / "short.toml")], seed=seed), folder / f"{seed}.rrd")


def _biased(folder):
    settings = [(0.0, "SIM_GYR1_BIAS_Y", 0.0), (90.0, "SIM_GYR1_BIAS_Y", 0.08)]
    flown = ardupilot(broken(gb.Bias(channel="q", onset_s=90.0, size=4.58)), settings=settings)
    (folder / "biased.bin").write_bytes(flown)


DEAR = {  # made for the cases that name it
    "1.rrd": lambda folder: _recorded(folder, 1),
    "2.rrd": lambda folder: _recorded(folder, 2),
    "biased.bin": _biased,
    "early.json": lambda folder: gb.save_monitor(early_monitor(), folder / "early.json"),
    "entry": lambda folder: write_scores(folder / "entry", load_definition(folder / "frozen.toml"), "test", finds),
}
frame_of = cache(gb.read_recording)


@cache
def groups():
    return tuple(figures_of(test_check.study()))


@pytest.fixture
def printed(folder, cli, monkeypatch, request):
    """Run a command line without `--json` and with it; return exit code, lines, and what was printed then."""

    def run(case):
        monkeypatch.chdir(folder)
        monkeypatch.setattr(tuning, "AXES", {})
        shorter = [
            (typed.replace("120", "75").replace("--onset 80", "--onset 50"), why) for typed, why in demo.COMMANDS
        ]
        monkeypatch.setattr(demo, "COMMANDS", shorter)
        monkeypatch.setattr(tuning, "_PROVED_S", 5.0)
        monkeypatch.setattr(definition, "shipped_benchmarks", lambda: {"gtmbench-2": folder / "frozen.toml"})
        monkeypatch.setattr("gtmbench.check.check.run_reference", lambda *_, **__: groups())
        monkeypatch.setattr("gtmbench.report.recording.read._rerun", lambda *_: ["true"])
        monkeypatch.setattr("gtmbench.report.recording.read.read_recording", frame_of)
        kept = {place: [] for place in WORKED_OUT}
        for place in WORKED_OUT:
            monkeypatch.setattr(place, _kept(_found(place), kept[place]))
        arguments = case.split()
        for name in DEAR.keys() & set(arguments):
            if not (folder / name).exists():
                DEAR[name](folder)
        if "c --report" in case and not (folder / "c").exists():  # workers share the cases as they come
            assert cli(*CASES["campaign"][2].split(), "-q")[0] == 0
        code, said, err = cli(*arguments)
        for made in ("x.toml", "checked/new.toml", "facts/aircraft.toml"):
            (folder / made).unlink(missing_ok=True)
        shutil.rmtree(folder / "seeds", ignore_errors=True)
        shutil.copy(folder / "checked/spoilt.toml", folder / "checked/renewed.toml")
        for place in WORKED_OUT:
            if kept[place]:
                monkeypatch.setattr(place, lambda *_, kept=kept[place], **__: kept.pop(0))
        again, out, noise = cli(*arguments, "--json")
        assert (again, noise) == (code, "")
        if case.startswith("live"):
            return _line_by_line(code, said, out, is_event="event" in request.node.name)
        return code, said or err.removeprefix("gtmbench: "), json.loads(out, parse_constant=pytest.fail)

    return run


def _line_by_line(code, said, out, *, is_event):
    """Return the last line of JSON, or the last event before it, and what people read instead."""
    *events, end = [json.loads(line, parse_constant=pytest.fail) for line in out.splitlines()]
    lines = said.splitlines()
    assert [event["verdict"] for event in events] == [line[25:] for line in lines[: len(events)]]
    validator = Draft202012Validator(schema("live-event"))
    assert [error.message for event in events for error in validator.iter_errors(event)] == []
    if is_event:
        return code, lines[len(events) - 1][25:], events[-1]
    return code, "\n".join(lines[len(events) :]), end


def _found(place):
    module, _, name = place.rpartition(".")
    return getattr(import_module(module), name)


def _kept(work, results):
    def worked(*given, **named):
        results.append(work(*given, **named))
        return results[-1]

    return worked


@cache
def schema(name):
    return json.loads(files("gtmbench").joinpath("schemas", f"{name}.json").read_text(encoding="utf-8"))


def _of_pieces(text):
    return " ".join(text.split())


LONG = {"aircraft, its gains", "demo", "fly, rescued", "live, an event", "live, failed", "live, healthy"}
LONG |= {"benchmark", "benchmark, written", "monitor, a fleet", "monitor, by itself"}
LONG |= {"score", "verify, equal", "verify, different", "view"}  # test_truth, test_diff and test_hostile run them
LONG |= {"calibrate, own relation", "monitor, healthy", "run, by a bank"}  # others of their schemas are of the day


@pytest.mark.parametrize("name", by_day(sorted(CASES, key=LONG.__contains__), len(CASES) - len(LONG)))
def test_what_is_printed_keeps_its_schema_and_says_what_people_read(name, printed):
    command, code, line = CASES[name]
    ended, said, told = printed(line)
    assert (ended, list(told)[:5]) == (code, FIRST), said
    assert (told["exit_code"], told["schema_version"], told["command"]) == (code, SCHEMA_VERSION, command)
    assert _of_pieces(said).startswith(_of_pieces(told["verdict"]))  # a screen may break it
    assert all(next(iter(row)) == "text" and row["text"] for row in told["findings"])
    if code == FAILED and command != "live-event":
        assert told["findings"]
    validator = Draft202012Validator(schema(command))
    assert [error.message for error in validator.iter_errors(told)] == []
    assert list(validator.iter_errors({**told, "unknown": 1}))
    assert list(validator.iter_errors({key: value for key, value in told.items() if key != "findings"}))


def test_every_command_has_a_schema_and_a_case():
    shipped = {path.name.removesuffix(".json") for path in files("gtmbench").joinpath("schemas").iterdir()}
    assert shipped == {command for command, _, _ in CASES.values()}
    assert {name.split("-")[0] for name in shipped - {"error"}} == set(COMMANDS)


@pytest.mark.parametrize("name", sorted({command for command, _, _ in CASES.values()}))
def test_a_schema_stands_alone_and_states_the_envelope(name):
    own = schema(name)
    Draft202012Validator.check_schema(own)
    assert (own["additionalProperties"], own["properties"]["command"]) == (False, {"const": name})
    assert list(own["properties"])[:5] == FIRST
    assert own["properties"]["schema_version"]["const"] == SCHEMA_VERSION
    assert set(own["required"]) == set(own["properties"])
    assert all("description" in one for one in own["properties"].values() if "const" not in one)
