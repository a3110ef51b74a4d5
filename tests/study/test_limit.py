"""The limit of quickest detection, held against a filter that is run on simulated gyros and angles."""

import math

import numpy as np
import pytest

import gtmbench as gb

PERIOD_S, GYRO, ANGLE = 0.01, 0.535, 0.02
QUIET = gb.Record(np.zeros((4001, 6)), channels=["p", "q", "r", "phi", "theta", "psi"], sample_period_s=PERIOD_S)


def likelihoods(change, channel, *, broken, runs=400, seed=1):
    """Return the log-likelihood ratio of a known change from its onset on, shape (runs, samples), by a Kalman filter.

    The filter starts from a variance that is far too large and runs for 20 s before the onset; its gain is found by
    iterating the Riccati equation. The signature comes from a second, noise-free filter.
    """
    draw, before = np.random.default_rng(seed), 2000
    count = before + len(change)
    added = np.concatenate([np.zeros(before), change])
    variance, seen = 1.0, (GYRO * PERIOD_S) ** 2
    estimate, clean = np.zeros(runs), 0.0
    ratio, ratios = np.zeros(runs), []
    for k in range(count):
        of_gyro, of_angle = (added[k], 0.0) if channel == "p" else (0.0, added[k])
        gyro = GYRO * draw.standard_normal(runs) + broken * of_gyro
        angle = ANGLE * draw.standard_normal(runs) + broken * of_angle  # the truth stands still
        estimate, clean = estimate + PERIOD_S * gyro, clean + PERIOD_S * of_gyro
        variance += seen
        spread = variance + ANGLE**2
        gain = variance / spread
        innovation, mean = angle - estimate, of_angle - clean
        estimate, clean = estimate + gain * innovation, clean + gain * mean
        variance *= 1.0 - gain
        if k >= before:
            ratio = ratio + (mean * innovation - mean**2 / 2.0) / spread
            ratios.append(ratio)
    return np.array(ratios).T


def limit(fault, rate=0.1):
    return gb.detection_limit(fault, QUIET, false_alarms_per_hour=rate)


FAULTS = [
    gb.Bias(channel="p", onset_s=5.0, size=0.3),
    gb.Drift(channel="p", onset_s=5.0, slope=0.1),
    gb.Oscillation(channel="p", onset_s=5.0, amplitude=1.0, frequency_hz=2.0),
    gb.Drift(channel="phi", onset_s=5.0, slope=0.05),
]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: f"{fault.kind} {fault.channel}")
def test_whoever_knows_all_but_the_onset_takes_as_long(fault):
    change = (gb.inject(QUIET, fault)[fault.channel])[500:]
    ratios = likelihoods(change, fault.channel, broken=True)
    crossed = ratios >= math.log(36000.0 / PERIOD_S)
    delays_s = np.where(crossed.any(axis=1), crossed.argmax(axis=1) * PERIOD_S, np.inf)
    assert np.median(delays_s) == pytest.approx(limit(fault), rel=0.12, abs=2 * PERIOD_S)


def test_on_healthy_readings_its_sum_rises_as_rarely_as_its_threshold_says():
    change = gb.inject(QUIET, FAULTS[0])["p"][500:1500]
    ratios = likelihoods(change, "p", broken=False, runs=2000)
    ever = float((ratios.max(axis=1) >= 3.0).mean())
    assert 0.3 * math.exp(-3.0) < ever < math.exp(-3.0)  # Ville's inequality; less by what it overshoots


def test_it_falls_with_the_size_and_rises_with_what_is_asked():
    sizes = [limit(gb.Bias(channel="q", onset_s=5.0, size=size)) for size in (0.2, 0.5, 1.0, 5.0)]
    assert sizes == sorted(sizes, reverse=True)
    rates = [limit(FAULTS[0], rate) for rate in (10.0, 0.1, 0.001)]
    assert rates == sorted(rates)
    louder = gb.detection_limit(FAULTS[0], QUIET, false_alarms_per_hour=0.1, noise={"p": 1.0})
    assert louder > limit(FAULTS[0])


def test_what_stays_below_it_is_infinite_and_a_sample_that_stops_is_seen_at_once():
    assert limit(gb.Bias(channel="p", onset_s=5.0, size=0.01)) == math.inf
    assert limit(gb.Dropout(channel="p", onset_s=5.0)) == 0.0


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (gb.Bias(channel="beta", onset_s=5.0, size=1.0), "the fault changes beta"),
        (gb.Swap(channel="p", onset_s=5.0, other="q"), "the fault changes p, q"),
        (gb.Bias(channel="p", onset_s=50.0, size=1.0), r"begins at 50 s, outside of the record \(0 to 40 s\)"),
    ],
)
def test_what_it_is_not_known_of_is_refused(fault, said):
    with pytest.raises(gb.InputError, match=said):
        limit(fault)


def test_a_rate_that_is_none_is_refused():
    with pytest.raises(gb.InputError, match="false_alarms_per_hour"):
        limit(FAULTS[0], 0.0)
