"""Only the engine names gyros and angles of a log: an alarm that it doesn't hold is doubted, and still listed."""

from types import SimpleNamespace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.alarm import MISSING, Alarm, Judgement
from gtmbench.log.judging.claims import UNHELD
from gtmbench.log.judging.monitored import is_held
from gtmbench.verdict.timeline import State


def alarm(*failed, candidates=None, test="", ended_s=None):
    """Return an alarm from 50 s on that names some sensors, or none of its candidates."""
    judged = Judgement(
        time_s=55.0,
        sensor=failed[0] if len(failed) == 1 else None,
        candidates=tuple(candidates or failed),
        together=tuple(
            Judgement(time_s=55.0, sensor=each, candidates=(each,))
            for each in failed[: len(failed) * (len(failed) > 1)]
        ),
    )
    return Alarm(number=0, time_s=51.0, onset_s=50.0, source="q", test=test, judgements=(judged,), ended_s=ended_s)


def engine(**since_s):
    """Return what names some sensors from a time on."""
    return SimpleNamespace(holds=lambda name, start_s, end_s: start_s <= end_s and end_s > since_s.get(name, np.inf))


def test_the_engine_holds_an_alarm_of_all_whom_it_names_meanwhile():
    assert is_held(alarm("q"), engine(q=60.0))
    assert not is_held(alarm("q", ended_s=59.0), engine(q=60.0))
    assert not is_held(alarm("q"), engine(p=60.0))
    assert is_held(alarm("p", "q"), engine(p=60.0, q=60.0))
    assert not is_held(alarm("p", "q"), engine(q=60.0))


def test_a_suspicion_of_gyros_or_angles_is_none_of_the_engines():
    assert not is_held(alarm(candidates=("q", "theta")), engine(q=60.0))
    assert not is_held(alarm(candidates=("beta", "r")), engine(r=60.0))


def test_of_missing_samples_and_of_other_sensors_the_engine_knows_nothing():
    for told in (alarm("q", test=MISSING), alarm("tas"), alarm(candidates=("alpha", "beta"))):
        assert is_held(told, engine())
    unjudged = Alarm(number=0, time_s=51.0, onset_s=50.0, source="q")
    assert is_held(unjudged, engine())  # which names nobody


@pytest.mark.nightly
def test_a_gyro_that_is_too_slow_is_not_judged_while_its_residual_is_high(tmp_path):
    flight = gb.measure(gb.fly("gtm", "multisine+turbulence", 110.0, seed=5), noise="t2", seed=5)
    six = flight.select(["p", "q", "r", "phi", "theta", "psi"])
    gb.write_log(gb.inject(six, gb.RateSaturation(channel="r", onset_s=70.0, rate_limit=12.0)), tmp_path / "slow.csv")
    watched = gb.watch_log(tmp_path / "slow.csv", "auto", attitude="own")
    assert not watched.verdict.failed
    assert (watched.timeline.at("r", 90.0).state, watched.timeline.at("r", 90.0).reason) == (State.NOT_JUDGED, UNHELD)
    told = [each for each in watched.alarms if each.last is not None and "r" in each.candidates]
    assert told
    assert not any(each.accuses for each in told)
    assert watched.timeline.at("p", 60.0).state is State.CLEAR
