"""Imperfect sensors: every figure means what its unit says, and only the named channels change."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lsim

from gtmbench.bench.sensors import LARGEST, Imperfections, imperfect, parse_imperfections
from gtmbench.errors import InputError
from gtmbench.values.record import Record

GYROS = ("p", "q", "r")
PERIOD_S = 0.01
LARGE = 100_000
FIVE = 5.0  # standard errors: passed by chance all but once in two million draws
EVERYTHING = Imperfections(bias=0.5, wander=0.2, lag_s=0.02, quantum=0.05)


def waves(channels, samples=1000):
    """Return a record in which channel i is a sinusoid of amplitude i + 1."""
    time_s = np.arange(samples) * PERIOD_S
    values = [(i + 1) * np.sin((1.0 + 0.1 * i) * time_s) for i in range(len(channels))]
    return Record(np.column_stack(values), channels=channels, sample_period_s=PERIOD_S, start_s=5.0)


def still(channels, samples, period_s=PERIOD_S):
    return Record(np.zeros((samples, len(channels))), channels=channels, sample_period_s=period_s)


def one(values, imperfections, period_s=PERIOD_S, **settings):
    """Return what an imperfect gyro p reads."""
    return imperfect(Record(values, channels=["p"], sample_period_s=period_s), imperfections, channels="p", **settings)[
        "p"
    ]


def test_perfect_sensors_read_the_record_bit_for_bit():
    record = waves(GYROS).replace("q", np.where(np.arange(1000) % 7, -0.0, np.nan))
    assert imperfect(record, Imperfections()).values.tobytes() == record.values.tobytes()


def test_the_other_channels_and_the_record_given_stay_as_they_were():
    record = waves(["beta", "p", "phi", "q", "elevator"]).replace("beta", np.full(1000, np.nan))
    before = record.values.copy()
    read = imperfect(record, EVERYTHING, channels=["q", "p"])
    for name in ("beta", "phi", "elevator"):
        assert read[name].tobytes() == record[name].tobytes()
    assert all((read[name] != record[name]).any() for name in "pq")
    np.testing.assert_array_equal(record.values, before)
    assert (read.channels, read.start_s) == (record.channels, record.start_s)


def test_adding_a_channel_changes_no_other():
    few = imperfect(waves(GYROS), EVERYTHING, channels=["q"], seed=4)
    many = imperfect(waves(GYROS), EVERYTHING, channels=["r", "q", "p"], seed=4)
    np.testing.assert_array_equal(few["q"], many["q"])


def test_every_seed_gives_its_own_bits():
    first, again, other = (imperfect(waves(GYROS), Imperfections(bias=0.5), seed=seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.values, again.values)
    assert not (first.values == other.values).any()


def test_a_longer_record_begins_like_a_shorter_one():
    long, short = (imperfect(waves(GYROS, samples), EVERYTHING) for samples in (1000, 300))
    np.testing.assert_array_equal(long.values[:300], short.values)


def test_the_steps_come_in_order_lag_bias_wander_quantum():
    steps = [Imperfections(lag_s=0.02), Imperfections(bias=0.5), Imperfections(wander=0.2), Imperfections(quantum=0.05)]
    record = waves(GYROS)
    for step in steps:
        record = imperfect(record, step)
    np.testing.assert_array_equal(imperfect(waves(GYROS), EVERYTHING).values, record.values)


def test_a_missing_sample_stays_missing_and_no_other_goes():
    record = waves("p")
    gaps = [0, 500, 501, 999]
    values = record["p"].copy()
    values[gaps] = np.nan
    assert np.flatnonzero(np.isnan(one(values, EVERYTHING))).tolist() == gaps
    assert np.isnan(one(np.full(5, np.nan), EVERYTHING)).all()


def test_a_record_without_samples_stays_one():
    assert len(imperfect(still(GYROS, 0), EVERYTHING)) == 0


# the biases


def test_the_turn_on_bias_is_constant_with_the_standard_deviation_given():
    channels = [f"gyro {i}" for i in range(500)]
    read = imperfect(still(channels, 3), Imperfections(bias=2.0), channels=channels).values
    assert (read == read[0]).all()
    assert np.mean(read[0]) == pytest.approx(0.0, abs=FIVE * 2.0 / np.sqrt(500))
    assert np.std(read[0]) == pytest.approx(2.0, rel=FIVE / np.sqrt(2 * 500))


@pytest.mark.parametrize("period_s", [0.01, 0.5])
def test_the_wander_gains_its_figure_times_the_root_of_time(period_s):
    walk = one(np.zeros(LARGE), Imperfections(wander=2.0), period_s)
    assert walk[0] == 0.0
    for stride in (1, 10):  # gains over one and over ten periods, not overlapping
        gains = np.diff(walk[::stride]) / (2.0 * np.sqrt(stride * period_s))
        assert np.mean(gains) == pytest.approx(0.0, abs=FIVE / np.sqrt(len(gains)))
        assert np.std(gains) == pytest.approx(1.0, rel=FIVE / np.sqrt(2 * len(gains)))
        assert np.mean(gains[1:] * gains[:-1]) == pytest.approx(0.0, abs=FIVE / np.sqrt(len(gains)))


def test_the_bias_wanders_on_while_samples_are_missing():
    values = np.zeros(1000)
    values[400:600] = np.nan
    whole, gap = one(np.zeros(1000), Imperfections(wander=1.0)), one(values, Imperfections(wander=1.0))
    np.testing.assert_array_equal(gap[600:], whole[600:])


# the lag


@pytest.mark.parametrize("lag_s", [1e-4, 0.005, 0.5, 100.0])
def test_the_lag_is_exact_where_the_signal_runs_straight_from_sample_to_sample(lag_s):
    rng = np.random.default_rng(1)
    values = 30.0 + np.cumsum(rng.standard_normal(2000))
    oracle = lsim(([1.0], [lag_s, 1.0]), values - values[0], np.arange(2000) * PERIOD_S)[1] + values[0]
    np.testing.assert_allclose(one(values, Imperfections(lag_s=lag_s)), oracle, rtol=0, atol=1e-9)


@pytest.mark.parametrize("lag_s", [1e-300, 1e-3, 0.05, 1e9])
def test_a_constant_passes_the_lag_unchanged_from_the_first_sample_on(lag_s):
    assert (one(np.full(100, 17.3), Imperfections(lag_s=lag_s)) == 17.3).all()


def test_noise_passes_the_lag():
    ratio = np.exp(-2.0)  # a lag of half a period
    now, before = 1.0 - (1.0 - ratio) / 2.0, (1.0 - ratio) / 2.0 - ratio
    variance = now**2 + (before + ratio * now) ** 2 / (1.0 - ratio**2)  # of the impulse response, summed
    assert np.sqrt(variance) == pytest.approx(0.68, abs=0.005)  # what the documentation says
    read = one(np.random.default_rng(1).standard_normal(LARGE), Imperfections(lag_s=PERIOD_S / 2))
    # correlation raises the standard error of a variance by no more than (1 + rho) / (1 - rho), rho below 0.4
    assert np.var(read) == pytest.approx(variance, rel=FIVE * np.sqrt(2 / LARGE * 1.4 / 0.6))


def test_the_lag_holds_its_state_over_missing_samples():
    values = waves("p")["p"].copy()
    there = np.ones(1000, dtype=bool)
    there[[0, 1, 300, 301, 302, 700]] = False
    shorter = one(values[there], Imperfections(lag_s=0.05))
    values[~there] = np.nan
    np.testing.assert_array_equal(one(values, Imperfections(lag_s=0.05))[there], shorter)


# the rounding


@pytest.mark.parametrize("quantum", [0.05, 0.25, 3.0])
def test_readings_are_the_nearest_multiples_of_the_quantum(quantum):
    values = np.random.default_rng(1).uniform(-20.0, 20.0, 10_000)
    read = one(values, Imperfections(quantum=quantum))
    steps = read / quantum
    np.testing.assert_allclose(steps, np.rint(steps), rtol=0, atol=1e-12 * 20.0 / quantum)
    assert np.abs(read - values).max() <= quantum / 2 * (1 + 1e-9)
    assert not np.signbit(read[read == 0.0]).any()


# what is refused, and the text


@pytest.mark.parametrize("name", ["bias", "wander", "lag_s", "quantum"])
@pytest.mark.parametrize("value", [-0.1, np.nan, np.inf, 1e12, "0.5", None, True])
def test_figures_that_cant_be_meant_are_refused(name, value):
    with pytest.raises(InputError, match=f"^{name} is .*it must be a finite number, 0 or more, at most [^\n]*$"):
        Imperfections(**{name: value})


def test_a_quantum_too_fine_to_round_is_refused():
    with pytest.raises(InputError, match=r"^quantum is 1e-300; it must be 0 \(none\) or 1e-09 or more$"):
        Imperfections(quantum=1e-300)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({}, "no channel 'q', 'r' in this record"),
        ({"channels": ["p", "x"]}, "no channel 'x' in this record"),
        ({"channels": ["p", "p"]}, "'p' is given twice in channels"),
        ({"channels": "p", "seed": -1}, "seed is -1"),
    ],
)
def test_arguments_that_cant_be_meant_are_refused(settings, message):
    with pytest.raises(InputError, match=message):
        imperfect(waves("p"), EVERYTHING, **settings)


def test_other_types_are_refused():
    with pytest.raises(InputError, match="a list was given for a Record"):
        imperfect([1.0, 2.0], EVERYTHING)
    with pytest.raises(InputError, match="give one such as Imperfections"):
        imperfect(waves(GYROS), {"bias": 0.5})
    with pytest.raises(InputError, match="imperfections are None; give them as text"):
        parse_imperfections(None)


def test_the_command_line_states_every_figure():
    text = "bias=0.5,wander=0.002,lag=0.005,quantum=0.05"
    meant = Imperfections(bias=0.5, wander=0.002, lag_s=0.005, quantum=0.05)
    assert parse_imperfections(text) == meant
    assert parse_imperfections(" quantum = 0.05 , lag=5e-3,wander=.002, bias=0.50 ") == meant
    assert parse_imperfections("lag=0") == Imperfections()
    assert str(meant) == "bias 0.5, wander 0.002, lag 0.005 s, quantum 0.05"


figures = st.floats(1e-9, LARGEST)


@given(bias=figures, wander=figures, lag_s=figures, quantum=figures)
def test_the_description_says_the_figures_exactly(**values):
    described = Imperfections(**values)
    assert parse_imperfections(str(described).replace(" s", "").replace(", ", ",").replace(" ", "=")) == described


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "imperfection '' isn't key=number"),
        ("bias", "imperfection 'bias' isn't key=number"),
        ("bias=0.5,", "imperfection '' isn't key=number"),
        ("lag_s=0.5", "imperfection 'lag_s=0.5' isn't key=number"),
        ("bias=0.5,bias=0.4", "'bias' is given twice"),
        ("lag=5ms", "imperfection lag is '5ms'; it must be a number, in s"),
        ("wander=", "imperfection wander is ''; it must be a number, in deg/s per sqrt"),
        ("lag=-0.1", "imperfection lag is -0.1; it must be a finite number, 0 or more"),
        ("bias=nan", "imperfection bias is nan"),
        ("quantum=inf", "imperfection quantum is inf"),
    ],
)
def test_text_that_cant_be_meant_is_refused(text, message):
    with pytest.raises(InputError, match=message) as refusal:
        parse_imperfections(text)
    assert "\n" not in str(refusal.value)


def test_a_wrong_key_is_told_the_legal_ones():
    with pytest.raises(InputError, match=r"bias \(deg/s\), wander \(deg/s per sqrt\(s\)\), lag \(s\), quantum \(deg/s"):
        parse_imperfections("drift=1")
