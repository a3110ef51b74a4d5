"""Diagnosis on the GTM: which sensor, what kind, how much; and nothing is said before it could be known."""

from dataclasses import replace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.errors import InputError

GYROS = ("p", "q", "r")
ONSET_S = 60.0


def sensors(seed, duration_s=120):
    return gb.measure(gb.fly("gtm", "multisine+turbulence", duration_s, seed=seed), noise="t2", seed=seed)


@pytest.fixture(scope="session")
def healthy_records():
    return [sensors(seed) for seed in range(1, 7)]


@pytest.fixture(scope="session")
def monitor(healthy_records):
    return gb.calibrate(healthy_records, bank=gb.load_bank("C"))


@pytest.fixture(scope="session")
def flight():
    return gb.fly("gtm", "multisine+turbulence", 120, seed=11)


@pytest.fixture(scope="session")
def healthy(flight):
    return gb.measure(flight, noise="t2", seed=11)


def faults(truth, channel, onset_s=ONSET_S, **settings):
    """Return every kind on a channel, strong enough to bite on what the aircraft does, and the true parameters."""
    x, common = truth[channel], {"channel": channel, "onset_s": onset_s, **settings}
    half, limit = 0.5 * np.std(x), 0.4 * np.abs(x).max()
    slew = 0.2 * np.abs(np.diff(x)).max() / truth.sample_period_s
    return {
        "drift": (gb.Drift(slope=0.2, **common), {"slope": 0.2, "onset_s": onset_s}),
        "deadzone": (gb.Deadzone(half_width=half, **common), {"half_width": half}),
        "saturation": (gb.Saturation(limit=limit, **common), {"limit": limit}),
        "rate_saturation": (gb.RateSaturation(rate_limit=slew, **common), {"rate_limit": slew}),
        "jam": (gb.Jam(**common), {}),
    }


KINDS = ("drift", "deadzone", "saturation", "rate_saturation", "jam")


@pytest.mark.parametrize("channel", GYROS)
@pytest.mark.parametrize("kind", KINDS)
def test_every_fault_of_a_gyro_is_named_and_measured(monitor, flight, healthy, channel, kind):
    fault, truth = faults(flight, channel)[kind]
    broken = gb.inject(healthy, fault)
    found = gb.watch(monitor, broken)
    assert len(found.findings) == 1
    (finding,) = found.findings
    assert finding.alarm_s > ONSET_S
    assert finding.isolated_s >= finding.alarm_s
    assert (finding.sensor, finding.verdict, finding.last.kind) == (channel, f"{channel} failed", kind)
    assert finding.ended_s is None
    if kind == "jam":
        truth = {"value": broken[channel][-1]}
    for name, value in truth.items():
        share = 0.0 if name == "onset_s" else 0.05 * abs(value)
        assert abs(finding.last.parameters[name] - value) <= 5.0 * finding.last.errors[name] + share + 1e-9


@pytest.mark.parametrize("kind", ["drift", "jam"])
@pytest.mark.parametrize("channel", ["phi", "theta", "psi"])
def test_a_fault_of_an_angle_is_one_of_the_reference(monitor, healthy, channel, kind):
    fault = {
        "drift": gb.Drift(channel=channel, onset_s=ONSET_S, slope=5.0),
        "jam": gb.Jam(channel=channel, onset_s=ONSET_S),
    }
    finding = gb.watch(monitor, gb.inject(healthy, fault[kind])).findings[0]
    assert finding.verdict == f"reference attitude failed ({channel})"


def test_a_healthy_record_gives_no_finding(monitor, healthy):
    found = gb.watch(monitor, healthy)
    assert found.findings == ()
    assert found.alarm_s is None
    assert all(np.nanmax(level.values) <= 1.0 for level in found.levels.values())


def test_two_gyros_at_once_are_two_findings(monitor, healthy):
    broken = gb.inject(
        gb.inject(healthy, gb.Jam(channel="p", onset_s=60.0)), gb.Drift(channel="r", onset_s=60.0, slope=0.5)
    )
    found = gb.watch(monitor, broken)
    assert {finding.sensor for finding in found.findings} == {"p", "r"}
    assert len(found.findings) == 2


@pytest.mark.parametrize("channel", GYROS)
def test_a_fault_that_ends_is_said_to_end_and_the_next_is_found(monitor, healthy, channel):
    once = gb.inject(healthy, gb.Jam(channel=channel, onset_s=50.0, duration_s=15.0))
    again = gb.inject(once, gb.Drift(channel=channel, onset_s=90.0, slope=1.0))
    found = gb.watch(monitor, again)
    assert [finding.sensor for finding in found.findings] == [channel, channel]
    first, second = found.findings
    assert first.ended_s == pytest.approx(65.0, abs=1.0)
    assert first.last.kind == "jam"
    assert second.alarm_s > 90.0
    assert second.last.kind == "drift"


# causality


def until(record, time_s):
    return record.between(record.start_s, time_s)


def said(watched, time_s):
    """Return what had been said by a time: alarms and judgements."""
    return [
        (one.alarm_s, one.onset_s, one.residual, one.series, [each for each in one.judgements if each.time_s <= time_s])
        for one in watched.findings
        if one.alarm_s <= time_s
    ]


def same(one, other):
    return repr(one) == repr(other)  # NaN, too


@pytest.mark.parametrize(
    "broken",
    [
        *((channel, kind) for channel in GYROS for kind in KINDS),
        *((channel, "jam") for channel in ("phi", "theta", "psi")),
    ],
    ids="-".join,
)
def test_a_judgement_stands_on_the_record_up_to_its_time(monitor, flight, healthy, broken):
    channel, kind = broken
    record = gb.inject(healthy, faults(flight, channel)[kind][0])
    whole = gb.watch(monitor, record)
    for finding in whole.findings:
        for judgement in finding.judgements:
            part = gb.watch(monitor, until(record, judgement.time_s))
            assert same(said(part, judgement.time_s), said(whole, judgement.time_s))
