"""Counting excitations: as many are found as there are, and every choice is a separate identification."""

import numpy as np
import pandas as pd
import pytest
import scipy.signal

import gtmbench as gb
from gtmbench.errors import InputError
from gtmbench.method.selection.inputs import _count
from gtmbench.report.figures.plot import excitation_figure
from tests.helpers.night import by_day
from tests.helpers.oracles import sampled


def zeros_and_poles(rng, count):
    """Return a polynomial with `count` (even) roots inside the unit circle."""
    radius, angle = rng.uniform(0.3, 0.85, count // 2), rng.uniform(0.0, np.pi, count // 2)
    return radius * np.exp(1j * angle)


def driven(seed, excitations, snr, *, sensors=5, samples=4000):
    """Return sensors that broadband excitations drive: one set of stable poles, zeros on both sides of the circle."""
    rng = np.random.default_rng([seed, excitations, snr])
    u = rng.standard_normal((samples + 200, excitations))
    poles = zeros_and_poles(rng, 2)
    values = np.zeros((samples + 200, sensors))
    for sensor in range(sensors):
        for source in range(excitations):
            zeros = zeros_and_poles(rng, 2)
            zeros = np.where(rng.random(1) < 0.5, zeros, 1.0 / zeros)
            response = scipy.signal.lfilter(*(np.poly([*z, *z.conj()]).real for z in (zeros, poles)), u[:, source])
            values[:, sensor] += response / response.std() * rng.uniform(0.5, 2.0)
    values = values[200:]
    values += rng.standard_normal(values.shape) * values.std(axis=0) / snr
    return sampled(values, [f"s{i}" for i in range(sensors)])


def counted(record, channels=None, **changes):
    asked = {"causal_order": 20, "noncausal_order": 20, **changes}
    return gb.count_excitations(record, channels=record.channels if channels is None else channels, **asked)


@pytest.mark.parametrize("snr", by_day([30, 100, 1000]))
@pytest.mark.parametrize("excitations", [1, 2, 3])
def test_as_many_excitations_are_counted_as_there_are(excitations, snr):
    """Zeros next to the unit circle can take more lags than there are: one of ten may be missed."""
    counts = [counted(driven(seed, excitations, snr)) for seed in range(10)]
    hits = [count.excitations == excitations for count in counts]
    assert sum(hits) >= 9, [count.reason for count in counts]
    assert all(count.reason.startswith(f"{excitations}: ") for count, hit in zip(counts, hits, strict=True) if hit)


def test_every_choice_is_what_a_separate_identification_finds():
    record = driven(3, 2, 30, samples=1000)
    table = counted(record, causal_order=3, noncausal_order=4).table
    assert len(table) == 5 * 4 + 10 * 3 + 10 * 2 + 5 * 1
    for row in table.sample(20, random_state=1).itertuples():
        asked = {"causal_order": 3, "noncausal_order": 4}
        operator = gb.identify(record, inputs=row.inputs, outputs=[row.output], **asked)
        expected = np.sqrt(operator.noise_variance[0]) / record[row.output].std()
        assert row.relative_residual == pytest.approx(expected, rel=1e-9)


def test_the_choices_are_one_gram_matrix(grams):
    counted(driven(3, 2, 30), causal_order=3, noncausal_order=4)
    assert len(grams) == 1


def test_neither_units_nor_the_order_of_channels_change_the_count():
    record = driven(3, 2, 30, samples=1500)
    count = counted(record)
    scaled = sampled(record.values * np.array([1e-6, 1.0, 1e3, 1e6, 50.0]) + 3.0, record.channels)
    other = counted(scaled, record.channels[::-1])
    assert count.excitations == other.excitations == 2
    np.testing.assert_allclose(count.by_m, other.by_m, rtol=1e-8)


def test_as_many_excitations_as_sensors_are_not_bounded():
    count = counted(driven(1, 3, 100, sensors=4), ["s0", "s1", "s2"])
    assert count.excitations is None
    alone = counted(driven(1, 3, 100, sensors=4))
    assert alone.excitations is None
    assert alone.reason.startswith("at least 3: ")


def test_noise_is_predicted_by_nothing():
    noise = sampled(np.random.default_rng(1).standard_normal((400, 4)), ["a", "b", "c", "d"])
    count = counted(noise, causal_order=10, noncausal_order=10)
    assert count.excitations is None
    assert count.reason.startswith("no choice of inputs predicts the others")
    np.testing.assert_allclose(count.by_m, 1.0, atol=0.1)  # short records feign no drop


def test_a_sinusoid_is_one_excitation_however_many_drive():
    """One frequency: two lags of any sensor hold all there is, as the docstring says."""
    angle = 2.0 * np.pi * np.arange(3000) / 50
    rng = np.random.default_rng(1)
    waves = [np.sin(angle + phase) for phase in rng.uniform(0, 6, 4)]
    record = sampled(np.column_stack(waves) + 0.01 * rng.standard_normal((3000, 4)), ["a", "b", "c", "d"])
    assert counted(record).excitations == 1


def test_sensors_without_noise_are_counted_too():
    rng = np.random.default_rng(1)
    record = sampled(rng.standard_normal((800, 2)) @ rng.standard_normal((2, 5)), ["a", "b", "c", "d", "e"])
    assert counted(record, causal_order=2, noncausal_order=2).excitations == 2


@pytest.mark.parametrize(
    ("curve", "excitations"),
    [
        ((0.1, 0.1 / 10**0.61, 0.02), 2),  # of the sharpest drop, on a logarithmic axis, three fifths
        ((0.1, 0.1 / 10**0.59, 0.02), 1),
        ((0.5263, 0.5263 / 1.51, 0.34), 2),  # and a half in any case
        ((0.5263, 0.5263 / 1.49, 0.34), 1),
    ],
)
def test_a_drop_is_sizable_beside_the_sharpest_one(curve, excitations):
    rows = [{"m": m, "inputs": ("a",), "output": "b", "relative_residual": left} for m, left in enumerate(curve, 1)]
    assert _count(rows, 1.5).excitations == excitations


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"channels": ["s0"]}, "channels names 1; it takes 2 to predict one another"),
        ({"channels": ["s0", "s0"]}, "'s0' is given twice"),
        ({"channels": ["s0", "alpha"]}, "no channel 'alpha'"),
        ({"channels": [f"s{i}" for i in range(11)]}, "11 channels are 2046 choices of inputs; give at most 10"),
        ({"gain": 1.0}, "gain is 1.0; it must be a finite number greater than 1$"),
        (
            {"causal_order": 90},
            "give 190 equations for 555 Markov parameters and a constant; record at least 666 samples",
        ),
        ({"noncausal_order": -1}, "noncausal_order is -1"),
    ],
    ids=str,
)
def test_what_excitations_cant_be_counted_from_is_refused(asked, message):
    record = driven(3, 2, 30, samples=300)
    with pytest.raises(InputError, match=message) as refused:
        counted(record, **asked)
    assert "\n" not in str(refused.value)


def test_the_figure_of_a_count_shows_every_choice(tmp_path):
    count = counted(driven(1, 2, 100))
    figure = excitation_figure(count)
    figure.savefig(tmp_path / "excitations.png")
    dots, curve, mark = figure.axes[0].lines
    assert len(dots.get_xdata()) == len(count.table)
    pd.testing.assert_series_equal(pd.Series(curve.get_ydata()[1:]), count.by_m, check_names=False, check_index=False)
    assert mark.get_xdata()[0] == 2
