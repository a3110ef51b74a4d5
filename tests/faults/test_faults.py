"""Faults: one contract for every kind of `FAULTS`, whatever it does; what each does is in `test_fault_kinds`."""

import inspect
import re
from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gtmbench as gb
from gtmbench.errors import InputError
from gtmbench.faults import registry as faults
from gtmbench.faults.fault import Fault, Parameter, inject, other_channel, severity
from gtmbench.faults.kinds.additive import Drift
from gtmbench.faults.kinds.shaping import Saturation
from gtmbench.faults.parameter import Intermittent
from gtmbench.values.channels import SENSORS
from gtmbench.values.record import Record
from tests.helpers.night import by_day

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


@dataclass(frozen=True, kw_only=True)
class Hold(Fault):
    """A user's own kind that carries something over, and says what it does of one sample only."""

    kind: ClassVar[str] = "hold"
    every: int = 4

    def distort_sample(self, now, elapsed_s, sample_period_s, carried):
        last, age = carried or (now[0], self.every)
        last, age = (now[0], 1) if age == self.every else (last, age + 1)
        return last, (last, age)


FAULTS = {**faults.FAULTS, "crosstalk": Crosstalk, "bias_step": BiasStep, "hold": Hold}
# parameters that bite on `flight()`; a severity that doesn't stand here is tried at 0.7, another channel is r
BITING = {"half_width": 0.8, "limit": 1.1, "rate_limit": 6.0, "frequency_hz": 1.3, "rate_hz": 40.0, "factor": 0.6}
BITING |= {"lag_s": 0.1, "delay_s": 0.035, "hold_s": 0.05, "angle_deg": 40.0, "seed": 3, "phase_deg": 20.0}
BITING |= {"replaces": False, "warming_s": 0.5, "slip": 0.3}
SEVERE = {
    kind: {item.name: "r" if item.is_channel else BITING.get(item.name, 0.7) for item in cls.parameters()}
    for kind, cls in FAULTS.items()
} | {"g_sensitivity": {"axis": "nz", "coefficient": 0.7}}
# what is missing doesn't show there
COVERS = ("jam", "float", "stuck", "hardover", "dropout", "stale", "delay", "clock_slip", "swap", "hold")
ROUNDED = (
    "oscillation",
    "lag",
    "thermal_bias",
)  # sines and filters of arrays may round otherwise than those of numbers
RANDOM = ("random_walk", "noise", "spikes")
every_kind = pytest.mark.parametrize("kind", FAULTS)


def flight(samples=400, *, start_s=START_S, missing=()):
    rng = np.random.default_rng(5)
    time_s = np.arange(samples) * PERIOD_S
    waves = 2.0 * np.sin(3.0 * time_s[:, np.newaxis] + [0.0, 1.0, 2.0, 0.5])
    waves[:, :3] += 0.1 * rng.standard_normal((samples, 3))
    waves[list(missing), 1] = np.nan
    return Record(waves, channels=["p", "q", "r", "nz"], sample_period_s=PERIOD_S, start_s=start_s)


def fault(kind, *, onset_s=ONSET_S, duration_s=DURATION_S, channel="q", **more):
    return FAULTS[kind](channel=channel, onset_s=onset_s, duration_s=duration_s, **SEVERE[kind] | more)


def streamed(broken, record):
    step = broken.stream(record.sample_period_s)
    readings = record.matrix(broken.reads)
    return [step(time, sample) for time, sample in zip(record.time_s, readings, strict=True)]


def assert_same(kind, one, other):
    if kind in ROUNDED:
        np.testing.assert_allclose(one, other, rtol=1e-15, atol=1e-14)
    else:
        np.testing.assert_array_equal(one, other)


def wide(samples=300):
    """Every sensor of the table, in sizes and with offsets of its own; the heading has turned twice."""
    time_s = np.arange(samples) * PERIOD_S
    rng = np.random.default_rng(6)
    values = {name: 2.0 * np.sin(6.0 * time_s + place) for place, name in enumerate(SENSORS)}
    values["psi"] = 700.0 + 40.0 * time_s
    values["tas"] += 75.0
    values["altitude"] = 800.0 + 5.0 * values["altitude"]
    noise = 0.01 * rng.standard_normal((samples, len(SENSORS)))
    return Record(np.column_stack(list(values.values())) + noise, channels=SENSORS, sample_period_s=PERIOD_S)


@every_kind
def test_a_kind_goes_by_its_own_name_and_reads_the_channels_it_names(kind):
    assert FAULTS[kind].kind == kind
    others = [name for name in SEVERE[kind].values() if isinstance(name, str)]
    assert fault(kind).reads == ("q", *others)
    of = {item.name for item in FAULTS[kind].parameters() if item.is_severity}
    assert fault(kind).severities == {name: value for name, value in SEVERE[kind].items() if name in of}


@every_kind
def test_a_kind_declares_every_field_that_a_scenario_may_give(kind):
    """What is required stands in the class's signature without a default, and the other way round."""
    common = {item.name for item in fields(Fault)}
    if kind in faults.FAULTS:
        assert {item.name for item in FAULTS[kind].parameters()} == {
            item.name for item in fields(FAULTS[kind])
        } - common
    required = {item.name for item in FAULTS[kind].parameters() if item.is_required}
    if required:
        with pytest.raises(TypeError, match=next(iter(required))):
            FAULTS[kind](channel="q", onset_s=ONSET_S)
    least = FAULTS[kind](channel="q", onset_s=ONSET_S, **{name: SEVERE[kind][name] for name in required})
    for item in FAULTS[kind].parameters():
        if not item.is_required:
            assert getattr(least, item.name) == item.default


@pytest.mark.parametrize("cls", faults.FAULTS.values(), ids=lambda cls: cls.kind)
def test_a_parameter_is_in_the_unit_that_its_description_says(cls):
    described = dict(re.findall(r"^(\w+) : [^\n]*\n((?: {4}[^\n]*\n)*)", inspect.getdoc(cls) + "\n", re.M))
    for item in cls.parameters():
        told = described[item.name]
        assert item.is_in_channels_unit == ("channel's unit" in told)
        assert item.per_second == ("channel's unit per second" in told)
        assert item.value_type is float or not item.is_severity


def test_without_bounds_a_parameter_is_any_finite_number():
    item = Parameter(name="size", is_severity=True, default=0.0)
    for value in (-1e300, 0.0, 1e300):
        item.check("own", value)


@every_kind
def test_only_what_it_names_changes_and_only_while_it_is_active(kind):
    record = flight()
    changed = inject(record, fault(kind)).values != record.values
    untouched = [i for i, name in enumerate(record.channels) if name not in fault(kind).changes]
    assert len(untouched) == (2 if kind == "swap" else 3)
    assert fault(kind).changes == (("q", "r") if kind == "swap" else ("q",))
    assert not changed[:, untouched].any()
    assert not changed[: ACTIVE.start].any()
    assert not changed[ACTIVE.stop :].any()
    assert changed[ACTIVE, 1].sum() > 20


@every_kind
@pytest.mark.parametrize("channel", by_day(["psi", "tas", "phi", "theta", "alpha", "beta", "altitude", "nx"], 2))
def test_any_sensor_may_break(kind, channel):
    record = wide()
    more = {"axis": "beta" if channel == "alpha" else "alpha"} if kind == "misalignment" else {}
    if kind == "misalignment" and channel in ("tas", "altitude", "nx"):
        with pytest.raises(InputError, match="it must be a channel in"):
            fault(kind, channel=channel, onset_s=1.0, **more)
        return
    broken = fault(kind, channel=channel, onset_s=1.0, duration_s=1.0, **more)
    after = inject(record, broken)
    changed = {name for name in SENSORS if not np.array_equal(after[name], record[name])}
    assert changed == set(broken.changes)
    assert kind == "dropout" or np.isfinite(after.values).all()
    assert_same(kind, streamed(broken, record), after[channel])


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
@pytest.mark.parametrize(
    ("onset_s", "missing"), [(START_S, (0,)), (ONSET_S, (119,)), (4.2049, (120, 121, 180, 399)), (6.99, ())], ids=str
)
def test_the_streaming_form_agrees_with_the_array_form(kind, onset_s, missing):
    record = flight(missing=missing)
    for duration_s in (None, 0.005, DURATION_S):
        broken = fault(kind, onset_s=onset_s, duration_s=duration_s)
        assert_same(kind, streamed(broken, record), broken.array(record))


comings = st.one_of(
    st.none(),
    st.builds(
        Intermittent,
        period_s=st.floats(0.03, 1.5),
        duty=st.floats(0.1, 0.5),
        jitter=st.floats(0.0, 0.5),
        seed=st.integers(0, 5),
    ),
)


@every_kind
@settings(max_examples=12)
@given(
    onset_s=st.floats(START_S, 4.0),
    duration_s=st.one_of(st.none(), st.floats(0.001, 2.0)),
    ramp_s=st.one_of(st.just(0.0), st.floats(0.001, 2.0)),
    intermittent=comings,
    missing=st.sets(st.integers(0, 149), max_size=20),
)
def test_stream_and_array_agree_however_a_fault_comes_and_goes(
    kind, onset_s, duration_s, ramp_s, intermittent, missing
):
    record = flight(150, missing=missing)
    broken = fault(kind, onset_s=onset_s, duration_s=duration_s, ramp_s=ramp_s, intermittent=intermittent)
    assert_same(kind, streamed(broken, record), broken.array(record))
    active = broken.active(record.time_s)
    np.testing.assert_array_equal([broken.active(time_s) for time_s in record.time_s.tolist()], active)
    np.testing.assert_array_equal(broken.array(record)[~active], record["q"][~active])


@every_kind
@settings(max_examples=12)
@given(data=st.data())
def test_a_fault_is_the_same_in_whatever_stretches_it_is_taken(kind, data):
    record = flight(missing=data.draw(st.sets(st.integers(119, 399), max_size=20)))
    broken = fault(kind, duration_s=None)
    readings = record.matrix(broken.reads)[ACTIVE.start :]
    elapsed_s = record.time_s[ACTIVE.start :] - ONSET_S
    cuts = sorted(data.draw(st.lists(st.integers(0, len(readings)), max_size=12)))
    carried = broken.begin(record.matrix(broken.reads)[ACTIVE.start - 1])
    pieces = []
    for rows in np.split(np.arange(len(readings)), cuts):
        piece, carried = broken.distort(readings[rows], elapsed_s[rows], PERIOD_S, carried)
        pieces.append(piece)
    np.testing.assert_array_equal(np.concatenate(pieces), broken.array(record)[ACTIVE.start :])


@every_kind
@pytest.mark.parametrize("onset_s", [START_S - 1.0, 4.2049])
def test_from_its_onset_on_it_reads_what_it_reads_in_the_whole_record(kind, onset_s):
    record, broken = flight(), fault(kind, onset_s=onset_s, duration_s=None)
    first = max(broken.onset_row(record), 0)
    assert first == np.argmax(record.time_s >= onset_s)
    healthy, read = broken.onwards(record, 300)
    np.testing.assert_array_equal(healthy, record["q"][first:300])
    np.testing.assert_allclose(read, broken.array(record)[first:300], atol=1e-12)


@every_kind
def test_what_stands_before_and_after_a_fault_doesnt_change_it(kind):
    """A longer record is broken alike, so what is drawn depends on the onset and the seed alone."""
    record = flight()
    part = record.between(4.0, 5.0)
    whole = fault(kind).array(record)[record.sample_range(4.0, 5.0).start :][: len(part)]
    np.testing.assert_allclose(fault(kind).array(part), whole, atol=1e-12)  # times are rounded otherwise


@pytest.mark.parametrize("kind", RANDOM)
def test_another_seed_onset_or_channel_gives_other_draws_of_the_same_kind(kind):
    record, zero = flight(3000), np.zeros((3000, 4))
    still = Record(zero, channels=record.channels, sample_period_s=PERIOD_S, start_s=START_S)
    one = fault(kind, duration_s=None).array(still)[ACTIVE.start :]
    for other in (fault(kind, duration_s=None, seed=4), fault(kind, duration_s=None, channel="p")):
        assert abs(np.corrcoef(one[1:], other.array(still)[ACTIVE.start + 1 :])[0, 1]) < (
            0.9 if kind == "random_walk" else 0.1
        )
    later = fault(kind, onset_s=ONSET_S + 1.0, duration_s=None).array(still)[ACTIVE.start + 100 :]
    np.testing.assert_allclose(later, one[:-100], atol=1e-12)  # the same sequence, from its onset


@pytest.mark.parametrize("kind", [kind for kind in FAULTS if kind not in COVERS])
@pytest.mark.parametrize("missing", [(50, 119, 249), (120, 180, 181, 300)], ids=str)
def test_a_missing_sample_is_missing_in_the_output_and_no_other_is(kind, missing):
    broken = inject(flight(missing=missing), fault(kind))["q"]
    assert tuple(np.flatnonzero(np.isnan(broken))) == missing


@pytest.mark.parametrize("kind", ["jam", "stuck", "hardover", "stale"])
def test_a_sensor_that_repeats_itself_covers_what_is_missing(kind):
    assert not np.isnan(inject(flight(missing=(120, 125, 180)), fault(kind))["q"][ACTIVE]).any()


@pytest.mark.parametrize("kind", ["jam", "stale"])
def test_what_it_began_with_is_missing_if_that_was(kind):
    """Where the sample before the onset is missing there is nothing to hold, and the output says so."""
    broken = inject(flight(missing=(119, 120)), fault(kind, **{"hold_s": 0.5} if kind == "stale" else {}))["q"]
    until = ACTIVE.stop if kind == "jam" else ACTIVE.start + 50
    assert np.flatnonzero(np.isnan(broken)).tolist() == list(range(119, until))


@every_kind
def test_a_ramp_lets_it_in_little_by_little(kind):
    """y + w (F(y) - y), with w from 0 at the onset to 1 after the ramp; from then on nothing is left of the ramp."""
    record = flight()
    at_once, ramped = (fault(kind, duration_s=None, ramp_s=ramp_s).array(record) for ramp_s in (0.0, 1.0))
    np.testing.assert_array_equal(ramped[ACTIVE.start + 101 :], at_once[ACTIVE.start + 101 :])
    if kind != "dropout":
        weight = np.clip((record.time_s - ONSET_S) / 1.0, 0.0, 1.0)
        np.testing.assert_allclose(ramped - record["q"], weight * (at_once - record["q"]), atol=1e-12)


@every_kind
@pytest.mark.parametrize("jitter", [0.0, 0.5])
def test_an_intermittent_fault_is_the_fault_while_it_is_on_and_nothing_in_between(kind, jitter):
    record = flight()
    times = Intermittent(period_s=0.5, duty=0.4, jitter=jitter, seed=2)
    broken = fault(kind, duration_s=None, intermittent=times)
    active, read = broken.active(record.time_s), broken.array(record)
    assert active[ACTIVE.start]
    assert active[ACTIVE.start : ACTIVE.start + 250].mean() == pytest.approx(0.4, abs=0.02)
    np.testing.assert_array_equal(read[~active], record["q"][~active])
    assert (read != record["q"])[active].sum() > 20
    if kind in ("jam", "rate_saturation", "hysteresis", "lag", "hardover", "hold"):  # what is carried begins anew
        for first, end in np.flatnonzero(np.diff(active, append=False)).reshape(-1, 2) + 1:
            alone = fault(kind, onset_s=float(record.time_s[first]), duration_s=None).array(record)
            np.testing.assert_array_equal(read[first:end], alone[first:end])


@given(period_s=st.floats(0.1, 3.0), duty=st.floats(0.05, 1.0), seed=st.integers(0, 99), share=st.floats(0.0, 1.0))
def test_an_intermittent_fault_is_on_once_a_period_for_its_share(period_s, duty, seed, share):
    times = Intermittent(period_s=period_s, duty=duty, jitter=share * (1.0 - duty), seed=seed)
    grid = 400
    on = times.is_on(np.arange(0.5, 20 * grid) / grid * period_s).reshape(20, grid)
    np.testing.assert_allclose(on.mean(axis=1), duty, atol=1.0 / grid)
    assert (np.diff(on.astype(int), axis=1, prepend=0, append=0) == 1).sum(axis=1).tolist() == [1] * 20
    begins = on.argmax(axis=1) / grid
    assert begins[0] == 0.0
    assert 0.5 * times.jitter - 1.0 / grid <= begins.max() <= times.jitter + 1.0 / grid  # of twenty draws


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"period_s": 0.0, "duty": 0.5}, "period_s is 0.0; it must be a finite number greater than 0"),
        ({"period_s": 1.0, "duty": 0.0}, "duty is 0.0; it must be .*greater than 0"),
        ({"period_s": 1.0, "duty": 1.2}, "duty is 1.2; it must be .*at most 1"),
        ({"period_s": 1.0, "duty": 0.5, "jitter": 0.6}, "jitter is 0.6; it must be .*at most 0.5"),
        ({"period_s": 1.0, "duty": 0.5, "seed": -1}, "seed is -1; it must be a whole number"),
    ],
)
def test_an_intermittence_that_cant_be_meant_is_refused(given, message):
    with pytest.raises(InputError, match=message):
        Intermittent(**given)


@every_kind
@pytest.mark.parametrize("clock", by_day([1.7e9, 0.0, 1e5]), ids=str)
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
    with pytest.raises(InputError, match="no channel 'strain' in this record; it has p, q, r, nz"):
        inject(flight(), fault(kind, channel="strain"))


@every_kind
@pytest.mark.parametrize("bad", by_day([np.inf, "5", np.nan, -np.inf, True, None], 2), ids=str)
def test_a_parameter_that_is_no_finite_number_is_refused(kind, bad):
    legal = {"channel": "q", "onset_s": ONSET_S, "duration_s": DURATION_S, **SEVERE[kind]}
    numbers = [item.name for item in FAULTS[kind].parameters() if item.value_type in (int, float)]
    names = ["onset_s", "ramp_s", *numbers, "duration_s"]
    if bad is None:  # it is what leaving them out means
        names = [name for name in names if name != "duration_s" and (kind, name) != ("hardover", "rate_limit")]
    for name in names:
        with pytest.raises(InputError, match=rf"{kind}: {name} is .*must be"):
            FAULTS[kind](**{**legal, name: bad})


@every_kind
@pytest.mark.parametrize("bad", by_day([0.0, -1.0]))
def test_a_duration_is_positive(kind, bad):
    with pytest.raises(InputError, match="must be a finite number greater than 0"):
        fault(kind, duration_s=bad)


@every_kind
def test_another_channel_is_named_and_is_another(kind):
    for item in FAULTS[kind].parameters():
        if item.is_channel:
            for bad in (None, 3):
                with pytest.raises(InputError, match=f"{item.name} is .*must be a channel's name"):
                    fault(kind, **{item.name: bad})
            with pytest.raises(InputError, match="'q' is its own other channel"):
                fault(kind, **{item.name: "q"})
        elif item.value_type is bool:
            with pytest.raises(InputError, match=f"{item.name} is 1; it must be true or false"):
                fault(kind, **{item.name: 1})


def test_what_says_when_it_is_on_is_an_intermittent():
    with pytest.raises(InputError, match=r"intermittent is 3; it must be Intermittent\(period_s=\.\.\., duty=\.\.\.\)"):
        fault("jam", intermittent=3)


@pytest.mark.parametrize("read", [(3, 90), (3, 50, 120)], ids=len)
def test_a_sensor_of_its_own_rate_breaks_where_it_reads_and_only_its_own_readings_count(read):
    values = np.full((200, 2), 7.0)
    values[np.setdiff1d(np.arange(200), read), 1] = np.nan
    record = Record(values, channels=["mag_x", "mag_y"], sample_period_s=PERIOD_S)
    drifted = Drift(channel="mag_y", onset_s=0.0, slope=2.0).array(record)
    np.testing.assert_allclose(drifted[list(read)], 7.0 + 2.0 * PERIOD_S * np.array(read), atol=1e-12)
    turned = FAULTS["misalignment"](channel="mag_y", onset_s=0.0, axis="mag_x", angle_deg=90.0, ramp_s=1e3)
    assert np.flatnonzero(np.isfinite(turned.array(record))).tolist() == list(read)
    moved = record.replace("mag_y", np.where(np.arange(200) == read[-1], 9.0, record["mag_y"]))
    lag = FAULTS["lag"](channel="mag_y", onset_s=0.0, lag_s=1.0).array(moved)[read[-1]]
    step_s = PERIOD_S * float(np.median(np.diff(read)))
    assert lag == pytest.approx(9.0 - 2.0 * (1.0 - np.exp(-step_s)) / step_s)  # behind a ramp from 7 to 9


def test_faults_are_stacked_in_the_order_given():
    record = flight()
    drift = Drift(channel="q", onset_s=ONSET_S, slope=5.0)
    limit = Saturation(channel="q", onset_s=ONSET_S, limit=1.0)
    stacked = inject(record, [drift, limit])
    np.testing.assert_array_equal(stacked.values, inject(inject(record, drift), limit).values)
    assert np.abs(stacked["q"][ACTIVE.start :]).max() == 1.0
    assert np.abs(inject(record, [limit, drift])["q"]).max() > 5.0


@pytest.mark.parametrize("is_said", [True, False])
def test_a_flag_in_a_line_is_true_or_false(is_said):
    wave = "oscillation:p:amplitude=1,frequency_hz=1,replaces="
    assert gb.fault(f"{wave}{str(is_said).lower()}", onset_s=0).replaces is is_said
    with pytest.raises(InputError, match="replaces is 'yes'; it must be true or false"):
        gb.fault(f"{wave}yes", onset_s=0)


def test_faults_on_different_channels_dont_meet():
    record = flight()
    faults = [fault("jam", channel="p"), fault("drift", channel="r")]
    both = inject(record, faults)
    np.testing.assert_array_equal(both.values, inject(record, faults[::-1]).values)
    for alone in faults:
        np.testing.assert_array_equal(both[alone.channel], inject(record, alone)[alone.channel])
    np.testing.assert_array_equal(inject(record, []).values, record.values)
