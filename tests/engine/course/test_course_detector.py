"""The cross-check: sensors that no gyro enters are named by the engine, in a record, a stream and a log."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.bench.attitude_filter import estimated_attitude
from gtmbench.detectors.alarm import Judgement
from gtmbench.engine.course import detector as subject
from gtmbench.testing.contract.subject import contract_case
from gtmbench.testing.contract.suite import CONTRACT, check_property
from gtmbench.values.channels import ATTITUDE, GPS_VELOCITY, GYROS
from gtmbench.verdict.timeline import SensorSpan, State
from tests.helpers.night import by_day

ONSET_S = 80.0


@pytest.fixture(scope="module")
def truth():
    return gb.fly("gtm", "multisine+turbulence", 150.0, seed=5)


def sensed(truth, *faults, seed=5):
    """Return readings with an attitude that the gyros, broken or not, drive."""
    readings = gb.measure(truth, noise="t2", seed=seed)
    readings = estimated_attitude(gb.inject(readings, faults) if faults else readings, truth, "filter 20 s", seed)
    readings = gb.with_magnetometer(readings, truth, gb.Magnetometer(declination_deg=10.0), seed=seed)
    return gb.with_gps(readings, truth, gb.Gps(delay_s=0.12), seed=seed)


@pytest.fixture(scope="module")
def flight(truth):
    return sensed(truth)


@pytest.fixture(scope="module")
def monitor(flight):
    return gb.CrossCheck().calibrate([flight])


def names(alarms):
    return {alarm.sensor for alarm in alarms}


@pytest.mark.parametrize(
    ("sensor", "fault"),
    by_day(
        [
            ("accelerometers", gb.Bias(channel="nz", onset_s=ONSET_S, size=0.4)),
            ("tas", gb.Jam(channel="tas", onset_s=ONSET_S)),
            ("altitude", gb.Jam(channel="altitude", onset_s=ONSET_S)),
            ("gps", gb.Jam(channel="gps_down", onset_s=ONSET_S)),
        ]
    ),
    ids=str,
)
def test_a_broken_sensor_is_named_when_it_could_be_known(flight, monitor, sensor, fault):
    alarms = monitor.watch(gb.inject(flight, fault).between(40.0, 125.0)).alarms
    assert names(alarms) == {sensor}
    assert ONSET_S < alarms[0].time_s < ONSET_S + 45.0
    assert alarms[0].onset_s == pytest.approx(ONSET_S, abs=5.0)
    assert alarms[0].time_s % 10.0 == pytest.approx(9.99)  # the last sample of ten seconds


@pytest.mark.nightly
def test_a_healthy_flight_raises_nothing(flight, monitor):
    assert monitor.watch(flight).alarms == ()


@pytest.mark.nightly
@pytest.mark.parametrize("channel", by_day(GYROS))
def test_a_gyro_that_drives_the_attitude_is_laid_on_nobody(truth, monitor, channel):
    fault = gb.Bias(channel=channel, onset_s=ONSET_S, size=4.0)
    assert names(monitor.watch(sensed(truth, fault)).alarms) <= {None}


@pytest.mark.nightly
def test_it_keeps_the_contract_of_detectors(truth):
    """All of it but one: its suspects are sensors of three axes, not channels."""
    records = [gb.decimate(sensed(truth, seed=seed), 4) for seed in (1, 2, 3)]
    case = contract_case(gb.CrossCheck(), records, fault=gb.Jam(channel="tas", onset_s=60.0))
    for name in CONTRACT:
        if name != "stated" and not name.startswith("stream by 1"):
            check_property(case, name)


@pytest.mark.nightly
def test_a_saved_monitor_says_the_same(flight, monitor, tmp_path):
    gb.save_monitor(monitor, tmp_path / "monitor.json")
    loaded = gb.load_monitor(tmp_path / "monitor.json")
    broken = gb.inject(flight, gb.Jam(channel="tas", onset_s=ONSET_S))
    assert loaded.watch(broken).alarms == monitor.watch(broken).alarms
    assert (loaded.suspects, loaded.channels) == (monitor.suspects, monitor.channels)


def test_one_that_once_learnt_bounds_is_refused_in_a_line(monitor, tmp_path):
    gb.save_monitor(monitor, tmp_path / "monitor.json")
    file = json.loads((tmp_path / "monitor.json").read_text())
    figures = file["figures"] | {"delay_s": 0.1, "field_ned": None, "learnt": {}, "own": {}, "entered": {}}
    kept = {key: value for key, value in file.items() if key not in ("digest", "figures", "version")}
    (tmp_path / "old.json").write_text(json.dumps({**kept, "version": 2, "figures": figures}))
    with pytest.warns(gb.NoteWarning), pytest.raises(gb.InputError, match="calibrate") as told:
        gb.load_monitor(tmp_path / "old.json")
    assert "\n" not in str(told.value)


def test_what_it_cant_do_is_said(flight):
    bare = flight.select([*GYROS, *ATTITUDE])
    with pytest.raises(gb.InputError, match="no two sensors to compare"):
        gb.CrossCheck().calibrate([bare])
    with pytest.raises(gb.InputError, match=r"can't promise 0\.1"):
        gb.CrossCheck().calibrate([flight], 0.1)
    with pytest.raises(gb.InputError, match="'psi'"):
        gb.CrossCheck().calibrate([flight.select(["p", "q", "r", "phi", "theta", *GPS_VELOCITY])])


# ---- when it looks, and at what


NAMES = (*GYROS, *ATTITUDE, *GPS_VELOCITY, "nx", "ny", "nz", "altitude")


def record_of(seconds, start_s=0.0):
    values = np.random.default_rng(1).standard_normal((round(2 * seconds), len(NAMES)))
    return gb.Record(values, channels=NAMES, sample_period_s=0.5, start_s=start_s)


def accuses(start_s, *sensors):
    """Return claims of sensors that are suspected together, or of one that failed."""
    judgement = Judgement(time_s=start_s, sensor=sensors[0], candidates=sensors)
    span = SensorSpan(
        start_s=start_s,
        end_s=999.0,
        state=State.FAILED,
        judgement=judgement,
        suspects=sensors if len(sensors) > 1 else (),
    )
    return [(sensor, span) for sensor in sensors]


@pytest.mark.parametrize("chunk_s", [0.5, 3.0, 10.0, 45.0, 200.0])
def test_every_ten_seconds_from_forty_on_it_looks_at_two_minutes(monkeypatch, chunk_s):
    looked = []
    monkeypatch.setattr(subject, "_accused", lambda past: looked.append((past.start_s, past.end_s)) or [])
    stream = gb.CrossCheck().restore({"sample_period_s": 0.5, "channels": list(NAMES)}).stream()
    for first_s in np.arange(0.0, 200.0, chunk_s):
        stream.push(record_of(200.0).between(first_s, min(first_s + chunk_s, 200.0) - 0.25))
    ends_s = np.arange(40.0, 200.1, 10.0)
    assert looked == [(max(end_s - 120.0, 0.0), end_s - 0.5) for end_s in ends_s]


def test_a_failure_is_alarmed_for_once_and_one_that_began_since_it_was_accused_last_again(monkeypatch):
    told = {
        39.5: accuses(20.0, "gps"),
        49.5: accuses(20.0, "gps"),  # the same
        59.5: [],
        69.5: accuses(49.6, "gps"),  # since 49.5 s it wasn't accused
        79.5: accuses(75.0, "tas", "gps") + accuses(60.0, "altitude"),
        89.5: accuses(80.0, "tas", "altitude"),  # both may be new
        99.5: accuses(89.0, "tas", "alpha"),  # one of both is known of since
    }
    monkeypatch.setattr(subject, "_accused", lambda past: told.get(past.end_s, []))
    monitor = gb.CrossCheck().restore({"sample_period_s": 0.5, "channels": list(NAMES)})
    alarms = monitor.watch(record_of(110.0)).alarms
    assert [(each.number, each.time_s, each.onset_s, each.last.candidates) for each in alarms] == [
        (0, 39.5, 20.0, ("gps",)),
        (1, 69.5, 49.6, ("gps",)),
        (2, 79.5, 75.0, ("tas", "gps")),
        (3, 79.5, 60.0, ("altitude",)),
        (4, 89.5, 80.0, ("tas", "altitude")),
    ]
    assert {each.last.time_s for each in alarms} == {39.5, 69.5, 79.5, 89.5}
    stream = monitor.stream()
    assert dict(stream.armed) == {"cross-check": True}
    assert [len(stream.push(record_of(110.0).between(a, b - 0.25))) for a, b in ((0.0, 60.0), (60.0, 110.0))] == [1, 4]


@pytest.mark.parametrize("is_accused", [True, False])
def test_gyros_and_attitude_are_asked_where_anybody_is_accused(monkeypatch, is_accused):
    asked = {}
    found, beside = (SimpleNamespace(accused=[1] * is_accused, standing=[]), SimpleNamespace(accused=[3], standing=[2]))
    monkeypatch.setattr(subject, "flight_of", lambda samples, **how: asked.update(how, six=[*samples]) or "flight")
    monkeypatch.setattr(subject, "course_judged", lambda _, others: asked.update(others=[*others]) or found)
    monkeypatch.setattr(subject, "judged", lambda flight: f"judged {flight}")
    monkeypatch.setattr(subject, "course_beside", lambda whole, _: asked.update(whole=whole) or beside)
    record = record_of(60.0)
    few = record.replace("altitude", np.where(np.arange(120) % 6 == 0, 1.0, np.nan))
    assert [*subject._accused(few)] == ([2, 3] if is_accused else [])
    assert (asked["is_driven"], asked["is_assumed"]) == (True, True)
    assert asked["others"] == [*NAMES[6:]]  # twenty readings are enough
    assert asked.get("whole") == ("judged flight" if is_accused else None)
    [*subject._accused(few.replace("altitude", np.where(np.arange(120) < 19, 1.0, np.nan)))]
    assert asked["others"] == [*NAMES[6:-1]]
    assert [*subject._accused(record.replace("psi", np.full(120, np.nan)))] == []


# ---- in a log


@pytest.fixture(scope="module")
def logs(flight, tmp_path_factory):
    """The same flight as logs at 25 Hz: healthy, and with two broken sensors."""
    folder = tmp_path_factory.mktemp("logs")
    faults = {
        "healthy": None,
        "nz": gb.Bias(channel="nz", onset_s=ONSET_S, size=0.4),
        "tas": gb.Jam(channel="tas", onset_s=ONSET_S),
    }
    for name, fault in faults.items():
        record = flight if fault is None else gb.inject(flight, fault)
        rows = {channel: record[channel][::4] for channel in record.channels}
        table = gb.Record(np.column_stack(list(rows.values())), channels=list(rows), sample_period_s=0.04)
        gb.write_log(table, folder / f"{name}.csv")
    return folder


@pytest.mark.parametrize("name", by_day(["nz", "tas"]))
def test_of_a_log_it_looks_at_these_alone_and_says_what_auto_says(logs, name):
    alone = gb.watch_log(logs / f"{name}.csv", "cross-check")
    beside = gb.watch_log(logs / f"{name}.csv", "auto")
    assert [sensor for sensor, _ in alone.verdict.failed] == [sensor for sensor, _ in beside.verdict.failed] == [name]
    assert alone.outcome is beside.outcome is gb.Outcome.FAILED
    assert not {*alone.verdict.scope.sensors} & {*GYROS, *ATTITUDE}
    assert {span.state for gyro in GYROS for span in alone.timeline.sensors[gyro]} == {State.NOT_JUDGED}


@pytest.mark.nightly
def test_of_a_healthy_log_it_cannot_tell_and_a_saved_one_says_the_same(logs, monitor, tmp_path):
    gb.save_monitor(monitor, tmp_path / "monitor.json")
    for detector in ("cross-check", tmp_path / "monitor.json"):
        watched = gb.watch_log(logs / "healthy.csv", detector)
        assert watched.outcome is gb.Outcome.UNKNOWN
        assert watched.verdict.failed == watched.verdict.suspected == ()
    with pytest.raises(gb.InputError, match="learns nothing; leave out what is healthy"):
        gb.watch_log(logs / "healthy.csv", "cross-check", healthy=[(0.0, 60.0)])


def test_nothing_is_learnt_of_a_log(logs, cli, tmp_path):
    given = "calibrate", str(logs / "healthy.csv"), "--detector", "cross-check", "--out", str(tmp_path / "mine.json")
    code, _, told = cli(*given)
    assert code == 2
    assert "learns nothing of logs; type gtmbench monitor" in told


@pytest.mark.nightly
def test_judge_all_asks_for_every_sensor_that_anything_compares(logs):
    usual, whole = (gb.watch_log(logs / "healthy.csv", "auto", judge=judge) for judge in (None, "all"))
    assert usual.outcome is gb.Outcome.HEALTHY
    assert whole.outcome is gb.Outcome.UNKNOWN
    asked = {*whole.verdict.scope.sensors}
    assert asked > {*GYROS, *ATTITUDE, "nx", "ny", "nz", "tas", "altitude"}
    assert {*whole.verdict.unjudged}.isdisjoint({*GYROS, *ATTITUDE, "nx", "ny", "nz", "altitude"})
    assert whole.verdict.reasons_of("magnetometer")[0].startswith("compared with others, and nothing was found")
    assert whole.verdict.sizes_of("nz").error < 0.2


@pytest.mark.nightly
def test_findings_of_other_sensors_stand_in_details_page_and_json(logs, cli, tmp_path):
    code, out, _ = cli("monitor", str(logs / "nz.csv"), "--json", "--report", str(tmp_path / "page.html"))
    found = json.loads(out)
    assert code == 1
    assert [(each["text"], each["kind"]) for each in found["findings"]] == [("accelerometers (nz) failed", "bias")]
    (told,) = (each for each in found["explained"] if each["names"] == "nz")
    assert told["kind"] == "bias"
    assert {each["relation"] for each in told["shown_by"]} >= {"gps and force"}
    assert {each["sensor"] for each in found["sensors"]} >= {"gps", "tas", "accelerometers"}
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "acceleration down by the GPS, less by the accelerometers" in page
    code, out, _ = cli("monitor", str(logs / "nz.csv"), "--details")
    assert "what explains other sensors over the whole log" in out
    assert "bias of nz" in out
    code, out, _ = cli("monitor", str(logs / "tas.csv"), "--details")
    assert "tas: stuck at" in out
