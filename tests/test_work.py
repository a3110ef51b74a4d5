"""Work counted, not timed: memory and FFT points of an identification."""

import tracemalloc

import numpy as np
import scipy.fft

from gtmbench.method.identify import identify
from gtmbench.record import Record


def found(one, orders):
    return identify(one, inputs=list("pqb"), outputs=["r"], causal_order=orders, noncausal_order=orders)


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
    one = white(17_500)
    peak = peak_of(lambda: found(one, 50))
    assert peak < 17_400 * 303 * 8 / 8


def test_memory_doesnt_grow_with_the_record():
    short, long = (peak_of(lambda one=one: found(one, 5)) for one in (white(200_000), white(800_000)))
    assert abs(long / short - 1.0) < 0.2


def test_the_work_is_proportional_to_the_samples(monkeypatch):
    """FFT points, counted: a channel's twice and a target's once, in segments of at least 8 L of which L overlap."""
    points = []

    def counted(values, n=None, transform=scipy.fft.rfft):
        made = transform(values, n) if n else transform(values)
        points.append(2 * (made.shape[-1] - 1) * made[..., 0].size)
        return made

    monkeypatch.setattr(scipy.fft, "rfft", counted)
    for samples in (100_000, 400_000):
        points.clear()
        found(white(samples), 50)
        assert sum(points) < 1.25 * 7 * samples
