"""Work counted, not timed: memory and FFT points of an identification."""

import tracemalloc

import numpy as np
import pytest

from gtmbench.method.identify import identify
from gtmbench.values.record import Record


def identified(record, orders, channels="pqb", weights=None):
    names = {"inputs": list(channels), "outputs": ["r"]}
    return identify(record, **names, causal_order=orders, noncausal_order=orders, weights=weights)


def peak_of(function):
    function()  # what is imported and cached at first isn't the work's
    tracemalloc.start()
    try:
        function()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def white(samples, channels="pqbr"):
    rng = np.random.default_rng(8)
    return Record(rng.standard_normal((samples, len(channels))), channels=list(channels), sample_period_s=0.01)


def test_an_identification_needs_an_eighth_of_the_regressors_memory():
    record = white(17_500)
    peak = peak_of(lambda: identified(record, 50))
    assert peak < 17_400 * 303 * 8 / 8


def test_memory_doesnt_grow_with_the_record():
    short, long = (peak_of(lambda record=record: identified(record, 5)) for record in (white(200_000), white(800_000)))
    assert abs(long / short - 1.0) < 0.2


@pytest.mark.nightly
def test_nor_where_every_sample_has_its_weight_or_an_orthogonal_method_takes_over():
    """Weights themselves are the record's; what is made beside them is less than the regressor's eighth."""
    record = white(100_000)
    weights = np.random.default_rng(9).random(len(record))
    exact = record.replace("r", record["p"] - 2.0 * record["b"])
    assert peak_of(lambda: identified(record, 20, weights=weights)) < 100_000 * 123 * 8 / 8
    assert identified(exact, 20).solver == "householder"
    assert peak_of(lambda: identified(exact, 20)) < 100_000 * 123 * 8 / 8


@pytest.mark.parametrize(("channels", "orders"), [("pqb", 50), ("p", 200)])
def test_the_work_is_proportional_to_the_samples(monkeypatch, channels, orders):
    """FFT points, counted: a channel's twice and a target's once, in segments of at least 8 L of which L overlap."""
    points = []

    def counted(values, n=None, transform=np.fft.rfft):
        made = transform(values, n) if n else transform(values)
        points.append(2 * (made.shape[-1] - 1) * made[..., 0].size)
        return made

    monkeypatch.setattr(np.fft, "rfft", counted)
    for samples in (100_000, 400_000):
        points.clear()
        identified(white(samples), orders, channels)
        assert samples < sum(points) < 1.25 * (2 * len(channels) + 1) * samples
