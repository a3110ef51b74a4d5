"""The closing word of a link: what arrived is judged as a log; until then alarms speak, and nobody is clear."""

import errno
import json

import pytest

import gtmbench as gb
from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.link import packets
from gtmbench.link.closing import FLYING, closed, verdict_so_far
from gtmbench.verdict.timeline import State
from gtmbench.verdict.verdict import Outcome
from tests.helpers import links, monitors
from tests.helpers.night import by_day

BIAS = gb.Bias(channel="q", onset_s=45.0, size=4.0)
SENSORS = ("p", "q", "theta")


def alarm(sensor="q", candidates=("q",), onset_s=90.0, ended_s=None, doubt=""):
    judged = Judgement(time_s=onset_s + 5.0, sensor=sensor, candidates=candidates, kind="bias", doubt=doubt)
    return Alarm(number=0, time_s=onset_s + 1.0, onset_s=onset_s, source="q", judgements=(judged,), ended_s=ended_s)


def so_far(*alarms):
    return verdict_so_far(SENSORS, (10.0, 130.0), alarms)


def states(said, sensor):
    return [(span.state.value, span.start_s, span.end_s) for span in said.timeline.sensors[sensor]]


def test_nobody_is_clear_while_it_flies():
    said = so_far()
    assert said.exit_code == 3
    assert {span.reason for name in SENSORS for span in said.timeline.sensors[name]} == {FLYING}


def test_an_alarm_fails_its_sensor_until_its_end():
    said = so_far(alarm())
    assert said.exit_code == 1
    assert states(said, "q") == [("not judged", 10.0, 90.0), ("failed", 90.0, 130.0)]
    over = so_far(alarm(ended_s=100.0))
    assert over.exit_code == 1
    assert states(over, "q")[-2:] == [("failed", 90.0, 100.0), ("not judged", 100.0, 130.0)]


def test_what_is_left_open_is_suspected_and_what_is_doubted_is_not_judged():
    open_one = so_far(alarm(None, ("q", "theta")))
    assert open_one.exit_code == 1
    assert [open_one.timeline.at(name, 100.0).state for name in ("q", "theta", "p")] == [
        State.SUSPECTED,
        State.SUSPECTED,
        State.NOT_JUDGED,
    ]
    doubted = so_far(alarm(None, ("q", "theta"), doubt="motion or model"))
    assert doubted.timeline.at("q", 100.0).reason == "motion or model"
    assert doubted.exit_code == 3


def test_an_alarm_of_a_sensor_that_is_not_asked_fails_all_the_same():
    assert so_far(alarm("tas", ("tas",))).exit_code == 1


@pytest.fixture(scope="module")
def sent():
    broken = gb.inject(monitors.record(3200, seed=21), BIAS)
    return {False: links.packets(monitors.record(4500, seed=21)), True: links.packets(broken)}


@pytest.mark.parametrize("is_given", by_day([True, False]))
@pytest.mark.parametrize("is_broken", by_day([True, False]))
def test_the_verdict_and_its_exit_code_are_those_of_monitor_on_the_saved_file(is_given, is_broken, sent, tmp_path, cli):
    """Whether a monitor is given or learnt on the way, on a link that loses, doubles and delays."""
    came, kept, monitor = tmp_path / "came.tlog", tmp_path / "kept.tlog", tmp_path / "monitor.json"
    links.saved(came, links.troubled(sent[is_broken], seed=3))
    gb.save_monitor(monitors.monitor(), monitor)
    option = ["--detector", str(monitor)] if is_given else []
    code, out, _ = cli("live", str(came), "--save", str(kept), *option, "--learn", "20", "--json")
    assert kept.read_bytes() == came.read_bytes()
    again, logged, _ = cli("monitor", str(kept), *(option or ["--detector", "auto"]), "--json")
    assert (code, json.loads(out.splitlines()[-1])["verdict"]) == (again, json.loads(logged)["verdict"])
    assert code == (Outcome.FAILED if is_broken else Outcome.HEALTHY)


def test_an_alarm_that_the_whole_flight_does_not_hold_stays_listed_as_unconfirmed(sent, tmp_path):
    log = links.saved(tmp_path / "saved.tlog", sent[True])
    told = [alarm(onset_s=56.0), alarm("p", ("p",), onset_s=30.0), alarm("q", onset_s=20.0, ended_s=30.0)]
    doubted = alarm("r", ("r",), onset_s=30.0, doubt="motion or model")
    said = closed(log, monitors.monitor(), [*told, doubted], mapping=(), attitude="auto", progress=lambda *_: None)
    assert said.unconfirmed == tuple(told[1:])
    assert said.verdict.outcome is Outcome.FAILED


def no_space(_arrived_s, _packet):
    raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.nightly
def test_what_could_not_be_kept_is_no_verdict_and_its_alarms_stand(sent, tmp_path, monkeypatch):
    """A full disk: silence says nothing, an alarm does."""
    outcomes = []
    logs = [links.saved(tmp_path / f"{is_broken}.tlog", sent[is_broken]) for is_broken in (False, True)]
    monkeypatch.setattr(packets, "_packet", no_space)
    for log, is_broken in zip(logs, (False, True), strict=True):
        _, link = links.said(gb.live(str(log), monitors.monitor()))
        outcomes.append(link.outcome)
        assert is_broken or "No space left on device" in link.verdict
    assert outcomes == [Outcome.UNKNOWN, Outcome.FAILED]


def test_a_link_that_was_silent_or_too_short_is_no_verdict(sent, tmp_path):
    for count in (1, 40):
        log = links.saved(tmp_path / f"{count}.tlog", sent[False][:count])
        _, link = links.said(gb.live(str(log), monitors.monitor()))
        assert link.outcome is Outcome.UNKNOWN
        assert link.verdict.startswith("Cannot tell"), link.verdict
