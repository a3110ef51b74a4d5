"""Gyros and attitudes that accelerometers contradict: what no aircraft does is told, and what one may do isn't."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.study.log.seconds import of_seconds
from gtmbench.study.log.standing import STANDING, standing_gyros
from gtmbench.study.log.vertical import contradiction, up_of
from gtmbench.verdict.verdict import Outcome

CHANNELS = ["p", "q", "r", "phi", "theta", "psi", "nx", "ny", "nz"]
PERIOD_S = 0.05


def made(seconds=120.0, *, quiet=1.0, seed=1, **columns):
    """Return an aircraft that stands level, with sensors' noise, and some columns otherwise."""
    time_s = np.arange(round(seconds / PERIOD_S)) * PERIOD_S
    table = {name: np.zeros(len(time_s)) for name in CHANNELS} | {"nz": np.ones(len(time_s))}
    table |= {name: np.broadcast_to(value(time_s), time_s.shape) for name, value in columns.items()}
    noise = np.random.default_rng(seed).standard_normal((len(time_s), 9)) * ([0.05] * 3 + [0.01] * 3 + [0.002] * 3)
    return gb.Record(np.column_stack(list(table.values())) + quiet * noise, channels=CHANNELS, sample_period_s=PERIOD_S)


def driven(rate):
    """Return the columns of a roll gyro's offset, which the attitude follows."""
    return {"p": lambda t: np.full_like(t, rate), "phi": lambda t: rate * t}


@pytest.mark.parametrize("rate", [-12.0, 5.0])
def test_a_gyro_that_turns_while_accelerometers_stand_is_named(rate):
    (alarm,) = standing_gyros([made(15.0, **driven(rate))])
    assert (alarm.sensor, alarm.test, alarm.last.kind, alarm.doubt) == ("p", STANDING, "bias", "")
    assert alarm.last.parameters["size"] == pytest.approx(rate, abs=0.1)
    assert "the aircraft stands for" in alarm.last.reason


def steady_turn(bank_deg=40.0, speed_m_s=15.0):
    """Return the columns of a coordinated turn."""
    rate = np.degrees(9.81 * np.tan(np.radians(bank_deg)) / speed_m_s)
    sine, cosine = np.sin(np.radians(bank_deg)), np.cos(np.radians(bank_deg))
    values = {"q": rate * sine, "r": rate * cosine, "phi": bank_deg, "nz": 1.0 / cosine}
    return {name: lambda t, value=value: np.full_like(t, value) for name, value in values.items()} | {
        "psi": lambda t: rate * t
    }


@pytest.mark.parametrize(
    "columns",
    [
        {},
        {"q": lambda t: np.full_like(t, 8.0)},  # an offset that the estimator corrects
        {"theta": lambda t: 3.0 * t},  # an attitude that wanders while the gyros are right
        {"r": lambda t: np.full_like(t, 20.0), "psi": lambda t: 20.0 * t},  # it turns on the spot
        driven(1.5),  # a raw offset
        steady_turn(15.0),
        steady_turn(40.0),
    ],
    ids=["stands", "offset", "attitude", "on the spot", "small", "shallow turn", "steep turn"],
)
def test_what_an_aircraft_or_a_healthy_gyro_may_do_accuses_nobody(columns):
    assert standing_gyros([made(60.0, **columns)]) == ()


def test_shaking_dead_and_missing_accelerometers_accuse_nobody():
    broken = made(15.0, **driven(-12.0))
    assert standing_gyros([made(15.0, quiet=20.0, **driven(-12.0))]) == ()
    dead = broken.replace("nx", np.zeros(len(broken))).replace("ny", np.zeros(len(broken)))
    assert standing_gyros([dead.replace("nz", np.ones(len(broken)))]) == ()
    assert standing_gyros([broken.select(CHANNELS[:6])]) == ()


@pytest.mark.parametrize(
    "columns",
    [
        {},
        steady_turn(60.0),
        {"phi": lambda t: np.where(t > 40.0, 180.0, 0.0), "nz": lambda t: np.where(t > 40.0, -1.0, 1.0)},
        {"phi": lambda t: np.where((t > 40.0) & (t < 43.0), 150.0, 0.0)},  # a roll
        {"nz": lambda t: np.full_like(t, -1.0)},  # mounted otherwise
        {"nz": lambda t: np.where(t > 40.0, 0.05, 1.0)},  # a fall
    ],
    ids=["stands", "steep turn", "upside down", "a roll", "mounted otherwise", "a fall"],
)
def test_an_attitude_that_accelerometers_bear_out_contradicts_nothing(columns):
    assert contradiction([made(**columns)]) == ""


def test_an_attitude_that_tumbles_alone_is_told_and_the_log_is_no_healthy_one(tmp_path):
    tumbling = made(phi=lambda t: np.clip(4.0 * (t - 30.0), 0.0, 170.0))
    assert "on the attitude contradicts the accelerometers: by both the vertical force is -0.9" in contradiction(
        [tumbling]
    )
    truth = gb.measure(gb.fly(excitation="multisine", duration_s=90, seed=3), noise="t2", seed=3).select(CHANNELS)
    assert contradiction([truth]) == ""
    assert standing_gyros([truth]) == ()
    for name, record in (
        ("healthy", truth),
        ("contradicts", truth.replace("nz", truth["nz"] - 1.2 * (truth.time_s > 50))),
    ):
        gb.write_log(record, tmp_path / f"{name}.csv")
    healthy, wrong = (
        gb.watch_log(tmp_path / f"{name}.csv", "C", healthy=[(0, 45)]) for name in ("healthy", "contradicts")
    )
    assert healthy.outcome is Outcome.HEALTHY
    # a vertical accelerometer that reads -0.2 g is no fall: nothing is contradicted, and only gyros are judged
    assert wrong.outcome is Outcome.HEALTHY


def test_up_is_where_a_level_accelerometer_reads_one_g():
    record = gb.Record([[0.0, 0.0], [90.0, 0.0], [0.0, 90.0]], channels=["phi", "theta"], sample_period_s=1.0)
    np.testing.assert_allclose(up_of(record), [[0, 0, 1], [0, -1, 0], [1, 0, 0]], atol=1e-12)


@pytest.mark.parametrize("start_s", [0.0, 3.3])
def test_seconds_are_those_of_the_rows_whatever_the_blocks(monkeypatch, start_s):
    values = np.random.default_rng(2).standard_normal((407, 2))
    values[100, 0] = np.nan
    record = gb.Record(values, channels=["p", "q"], sample_period_s=0.1, start_s=start_s)
    whole = of_seconds(record, 0.0, lambda part: part.values)
    monkeypatch.setattr("gtmbench.study.log.seconds._BLOCK", 7)
    blocks = of_seconds(record, 0.0, lambda part: part.values)
    np.testing.assert_array_equal(whole.at, blocks.at)
    np.testing.assert_allclose(whole.means, blocks.means)
    for at, first, stop in zip(whole.at, whole.first_row, whole.stop_row, strict=True):
        row = int(np.flatnonzero(whole.at == at)[0])
        np.testing.assert_allclose(whole.means[row], values[first:stop].mean(axis=0))
        np.testing.assert_allclose(whole.deviations[row], values[first:stop].std(axis=0))
