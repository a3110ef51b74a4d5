"""Faults: one contract for every kind of `FAULTS`, and the property that makes each what it is."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from gtmbench.detectors.isolation.hypotheses import HYPOTHESES, Stretch
from gtmbench.errors import InputError
from gtmbench.faults import kinds as faults
from gtmbench.faults.fault import Fault, inject, other_channel, severity
from gtmbench.faults.kinds import Deadzone, Drift, Jam, RateSaturation, Saturation
from gtmbench.record import Record

PERIOD_S = 0.01
START_S, ONSET_S, DURATION_S = 3.0, 4.2, 1.3
ACTIVE = slice(120, 250)  # the samples of that onset and duration


@dataclass(frozen=True, kw_only=True)
class Crosstalk(Fault):
    """A toy under the same contract: part of another channel leaks in."""

    kind: ClassVar[str] = "crosstalk"
    source: str = other_channel()
    slope: float = severity(per_second=True)

    def distort(self, readings, elapsed_s, sample_period_s, carried):
        return readings[:, 0] + self.slope * sample_period_s * readings[:, 1], None


@dataclass(frozen=True, kw_only=True)
class BiasStep(Fault):
    """A user's own kind, as it stands in a file of theirs: nothing is registered."""

    kind: ClassVar[str] = "bias_step"
    size: float = severity(per_second=False)

    def distort(self, readings, elapsed_s, sample_period_s, carried):
        return readings[:, 0] + self.size, None


FAULTS = {**faults.FAULTS, "crosstalk": Crosstalk, "bias_step": BiasStep}
# severities that bite on `flight()`; a new kind is tried at 0.7 unless it stands here
BITING = {"half_width": 0.8, "limit": 1.1, "rate_limit": 6.0}
SEVERE = {
    kind: {item.name: BITING.get(item.name, 0.7) if item.is_severity else "r" for item in cls.parameters()}
    for kind, cls in FAULTS.items()
}
every_kind = pytest.mark.parametrize("kind", FAULTS)


def flight(samples=400, *, start_s=START_S, missing=()):
    rng = np.random.default_rng(5)
    time_s = np.arange(samples) * PERIOD_S
    waves = 2.0 * np.sin(3.0 * time_s[:, np.newaxis] + [0.0, 1.0, 2.0]) + 0.1 * rng.standard_normal((samples, 3))
    waves[list(missing), 1] = np.nan
    return Record(waves, channels=["p", "q", "r"], sample_period_s=PERIOD_S, start_s=start_s)


def fault(kind, *, onset_s=ONSET_S, duration_s=DURATION_S, channel="q"):
    return FAULTS[kind](channel=channel, onset_s=onset_s, duration_s=duration_s, **SEVERE[kind])


def streamed(broken, record):
    step = broken.stream(record.sample_period_s)
    readings = record.matrix(broken.reads)
    return [step(time, sample) for time, sample in zip(record.time_s, readings, strict=True)]


@every_kind
def test_a_kind_goes_by_its_own_name_and_reads_the_channels_it_names(kind):
    assert FAULTS[kind].kind == kind
    others = [name for name in SEVERE[kind].values() if isinstance(name, str)]
    assert fault(kind).reads == ("q", *others)
    assert fault(kind).severities == {k: v for k, v in SEVERE[kind].items() if not isinstance(v, str)}


@every_kind
def test_only_its_channel_changes_and_only_while_it_is_active(kind):
    record = flight()
    changed = inject(record, fault(kind)).values != record.values
    assert not changed[:, [0, 2]].any()
    assert not changed[: ACTIVE.start].any()
    assert not changed[ACTIVE.stop :].any()
    assert changed[ACTIVE, 1].sum() > 20


@every_kind
def test_without_a_duration_it_lasts_to_the_end(kind):
    record = flight()
    for_good, long = (inject(record, fault(kind, duration_s=duration_s))["q"] for duration_s in (None, 1e6))
    np.testing.assert_array_equal(for_good, long)
    assert np.flatnonzero(for_good != record["q"])[-1] > ACTIVE.stop + 100


@every_kind
def test_the_input_is_left_alone_and_the_same_call_gives_the_same_bits(kind):
    record = flight()
    before = record.values.copy()
    first, again = (inject(record, fault(kind)) for _ in range(2))
    np.testing.assert_array_equal(record.values, before)
    np.testing.assert_array_equal(first.values, again.values)
    assert (first.channels, first.start_s, first.sample_period_s) == (record.channels, START_S, PERIOD_S)


@every_kind
@pytest.mark.parametrize("onset_s", [START_S, ONSET_S, 4.2049, 6.99], ids=str)
@pytest.mark.parametrize("missing", [(), (0,), (119,), (120, 121, 180, 399)], ids=str)
def test_the_streaming_form_agrees_with_the_array_form(kind, onset_s, missing):
    record = flight(missing=missing)
    for duration_s in (None, 0.005, DURATION_S):
        broken = fault(kind, onset_s=onset_s, duration_s=duration_s)
        np.testing.assert_array_equal(streamed(broken, record), broken.array(record))


@every_kind
@pytest.mark.parametrize("seed", range(5))
def test_a_fault_is_the_same_in_whatever_stretches_it_is_taken(kind, seed):
    broken, record = fault(kind, duration_s=None), flight(missing=(200, 260))
    readings = record.matrix(broken.reads)[ACTIVE.start :]
    elapsed_s = record.time_s[ACTIVE.start :] - ONSET_S
    cuts = np.sort(np.random.default_rng(seed).integers(0, len(readings), 12))
    carried = broken.begin(record.matrix(broken.reads)[ACTIVE.start - 1])
    pieces = []
    for rows in np.split(np.arange(len(readings)), cuts):
        piece, carried = broken.distort(readings[rows], elapsed_s[rows], PERIOD_S, carried)
        pieces.append(piece)
    np.testing.assert_array_equal(np.concatenate(pieces), broken.array(record)[ACTIVE.start :])


@pytest.mark.parametrize("kind", [kind for kind in FAULTS if kind != "jam"])
@pytest.mark.parametrize("missing", [(50,), (119,), (120,), (180, 181), (249,), (300,)], ids=str)
def test_a_missing_sample_is_missing_in_the_output_and_no_other_is(kind, missing):
    broken = inject(flight(missing=missing), fault(kind))["q"]
    assert tuple(np.flatnonzero(np.isnan(broken))) == missing


def test_a_jam_covers_what_is_missing_but_holds_what_it_began_with():
    """Where the sample before the onset is missing there is nothing to hold, and the output says so."""
    assert not np.isnan(inject(flight(missing=(120, 180)), fault("jam"))["q"]).any()
    began_with_nothing = inject(flight(missing=(119,)), fault("jam"))["q"]
    assert np.flatnonzero(np.isnan(began_with_nothing)).tolist() == list(range(119, ACTIVE.stop))


@every_kind
@pytest.mark.parametrize("clock", [0.0, 1e5, 1.7e9], ids=["0", "a day", "Unix"])
def test_the_sample_at_the_onset_is_the_first_one_to_break(kind, clock):
    record = flight(start_s=clock)
    broken = fault(kind, onset_s=float(record.time_s[120]), duration_s=None)
    assert np.flatnonzero(broken.active(record.time_s))[0] == 120


@every_kind
def test_an_onset_at_the_end_of_the_record_is_legal_and_outside_is_not(kind):
    record = flight()
    last = inject(record, fault(kind, onset_s=record.end_s))["q"]
    np.testing.assert_array_equal(last[:-1], record["q"][:-1])
    for outside in (record.start_s - 0.001, record.end_s + 0.001, -1.0):
        with pytest.raises(InputError, match=r"outside of the record, which runs from 3 to 6\.99 s"):
            inject(record, fault(kind, onset_s=outside))


@every_kind
def test_an_unknown_channel_is_refused_with_the_ones_there_are(kind):
    with pytest.raises(InputError, match="no channel 'beta' in this record; it has p, q, r"):
        inject(flight(), fault(kind, channel="beta"))


@every_kind
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, "5", True, None], ids=str)
def test_a_parameter_that_is_no_finite_number_is_refused(kind, bad):
    legal = {"channel": "q", "onset_s": ONSET_S, "duration_s": DURATION_S, **SEVERE[kind]}
    severities = [name for name, value in SEVERE[kind].items() if not isinstance(value, str)]
    names = ["onset_s", *severities, *(["duration_s"] if bad is not None else [])]
    for name in names:
        with pytest.raises(InputError, match=rf"{kind}: {name} is .*must be"):
            FAULTS[kind](**{**legal, name: bad})


@every_kind
@pytest.mark.parametrize("bad", [0.0, -1.0])
def test_a_duration_is_positive(kind, bad):
    with pytest.raises(InputError, match="must be a finite number greater than 0"):
        fault(kind, duration_s=bad)


@pytest.mark.parametrize("cls", [Deadzone, Saturation, RateSaturation])
def test_a_width_or_limit_is_not_negative(cls):
    (item,) = cls.parameters()
    with pytest.raises(InputError, match=f"{cls.kind}: {item.name} is -0.1; it must be a finite number, 0 or more"):
        cls(channel="q", onset_s=ONSET_S, **{item.name: -0.1})


@pytest.mark.parametrize(("onset_s", "slope"), [(ONSET_S, 0.05), (4.2049, -3.0)])
def test_a_drift_adds_a_ramp_of_its_slope_from_its_onset(onset_s, slope):
    record = flight()
    added = inject(record, Drift(channel="q", onset_s=onset_s, slope=slope))["q"] - record["q"]
    since = record.time_s - onset_s
    np.testing.assert_allclose(added, slope * np.where(since > -1e-9, since, 0.0), atol=1e-12)


def test_a_deadzone_swallows_the_small_and_shortens_the_rest():
    record = flight()
    y, broken = record["q"], inject(record, Deadzone(channel="q", onset_s=START_S, half_width=0.8))["q"]
    small = np.abs(y) <= 0.8
    assert 20 < small.sum() < 380
    assert not broken[small].any()
    np.testing.assert_allclose(np.abs(broken[~small]), np.abs(y[~small]) - 0.8, atol=1e-12)
    np.testing.assert_array_equal(np.sign(broken[~small]), np.sign(y[~small]))


@pytest.mark.parametrize("cls", [Deadzone, Saturation, RateSaturation, Jam])
def test_what_breaks_alike_on_both_sides_is_odd(cls):
    record = flight()
    mirrored = Record(-record.values, channels=record.channels, sample_period_s=PERIOD_S, start_s=START_S)
    broken = cls(channel="q", onset_s=ONSET_S, **SEVERE[cls.kind])
    np.testing.assert_array_equal(inject(mirrored, broken)["q"], -inject(record, broken)["q"])


def test_a_saturation_bounds_and_leaves_what_is_inside():
    record = flight()
    y, broken = record["q"], inject(record, Saturation(channel="q", onset_s=START_S, limit=1.1))["q"]
    assert np.abs(broken).max() == 1.1
    inside = np.abs(y) <= 1.1
    np.testing.assert_array_equal(broken[inside], y[inside])
    np.testing.assert_array_equal(broken[~inside], 1.1 * np.sign(y[~inside]))


@pytest.mark.parametrize("missing", [(), (180, 181, 182)], ids=str)
def test_a_rate_saturation_starts_from_the_last_healthy_sample_and_bounds_every_step(missing):
    broken = inject(flight(missing=missing), RateSaturation(channel="q", onset_s=ONSET_S, rate_limit=6.0))["q"]
    known = np.delete(broken, missing)  # a gap is passed over: it is no leave to jump
    assert np.abs(np.diff(known[ACTIVE.start - 1 :])).max() == pytest.approx(6.0 * PERIOD_S, abs=1e-12)


def test_a_rate_saturation_never_overshoots_what_it_follows():
    record = flight()
    y, broken = record["q"], inject(record, RateSaturation(channel="q", onset_s=ONSET_S, rate_limit=6.0))["q"]
    for k in range(ACTIVE.start, len(y)):
        low, high = sorted((broken[k - 1], y[k]))
        assert low - 1e-12 <= broken[k] <= high + 1e-12


def test_a_signal_slower_than_the_limit_passes_a_rate_saturation_bit_for_bit():
    """Scoring counts altered samples: rounding would count as a fault."""
    record = flight()
    fastest = np.abs(np.diff(record["q"])).max() / PERIOD_S
    broken = inject(record, RateSaturation(channel="q", onset_s=ONSET_S, rate_limit=1.01 * fastest))["q"]
    np.testing.assert_array_equal(broken, record["q"])


def test_a_rate_saturation_of_0_and_a_jam_are_the_same():
    stuck = RateSaturation(channel="q", onset_s=ONSET_S, duration_s=DURATION_S, rate_limit=0.0)
    np.testing.assert_array_equal(inject(flight(), stuck).values, inject(flight(), fault("jam")).values)


def test_a_jam_stays_at_the_last_healthy_sample():
    record = flight()
    assert set(inject(record, fault("jam"))["q"][ACTIVE]) == {record["q"][ACTIVE.start - 1]}
    at_the_start = inject(record, Jam(channel="q", onset_s=START_S))["q"]
    assert set(at_the_start) == {record["q"][0]}


def test_faults_are_stacked_in_the_order_given():
    record = flight()
    drift = Drift(channel="q", onset_s=ONSET_S, slope=5.0)
    limit = Saturation(channel="q", onset_s=ONSET_S, limit=1.0)
    stacked = inject(record, [drift, limit])
    np.testing.assert_array_equal(stacked.values, inject(inject(record, drift), limit).values)
    assert np.abs(stacked["q"][ACTIVE.start :]).max() == 1.0
    assert np.abs(inject(record, [limit, drift])["q"]).max() > 5.0


def test_faults_on_different_channels_dont_meet():
    record = flight()
    faults = [fault("jam", channel="p"), fault("drift", channel="r")]
    both = inject(record, faults)
    np.testing.assert_array_equal(both.values, inject(record, faults[::-1]).values)
    for alone in faults:
        np.testing.assert_array_equal(both[alone.channel], inject(record, alone)[alone.channel])
    np.testing.assert_array_equal(inject(record, []).values, record.values)


@pytest.mark.parametrize("kind", HYPOTHESES)
def test_a_diagnosis_makes_of_a_virtual_sensor_what_injecting_makes_of_the_signal(kind):
    """To the last bit: it is the same code, under the same name."""
    record = Record(np.random.default_rng(4).normal(0.0, 3.0, 200), channels=["p"], sample_period_s=0.02)
    cls, rows = faults.FAULTS[kind], slice(80, None)
    severities = {each.name: 1.3 for each in cls.parameters() if each.is_severity}
    broken = cls(channel="p", onset_s=1.6, **severities).array(record)
    stretch = Stretch(
        channel="p",
        measured=broken[rows],
        virtual=record["p"][rows],
        before=float(record["p"][79]),
        time_s=record.time_s[rows],
        earliest_s=0.0,
        sample_period_s=record.sample_period_s,
    )
    parameters = {**severities, "onset_s": 1.6, "value": stretch.before}
    np.testing.assert_array_equal(HYPOTHESES[kind].reads(stretch, parameters), broken[rows])
    assert HYPOTHESES[kind].kind == kind
