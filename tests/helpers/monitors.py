"""Made-up records with attitude and gyros that agree, and monitors calibrated on them: quick, and without the bench."""

from functools import cache

import numpy as np
from filelock import FileLock

import gtmbench as gb
from gtmbench.files.artefacts import artefacts

NAMES = ("p", "q", "r", "phi", "theta", "psi", "alpha", "beta", "ny", "nz", "tas")
NOISE = (0.5, 0.5, 0.3, 0.02, 0.02, 0.02, 0.03, 0.03, 0.002, 0.007, 0.06)


def truth(samples=6000, seed=1, period_s=0.02):
    """Return what `record` has before its noise: the channels of all banks; the rates follow from the attitude."""
    return _truth(np.random.default_rng(seed), samples, period_s)


def record(samples=6000, seed=1, period_s=0.02):
    """Return a healthy record, as sensors read it."""
    random = np.random.default_rng(seed)
    values = _truth(random, samples, period_s).values + np.array(NOISE) * random.standard_normal((samples, len(NAMES)))
    return gb.Record(values, channels=NAMES, sample_period_s=period_s)


def chunks(of, rows):
    """Yield a record in parts of so many rows."""
    for first in range(0, len(of), rows):
        yield of.part(range(first, min(first + rows, len(of))))


def streamed(monitor, of, rows):
    """Return a stream that was given a record in parts of so many rows."""
    stream = monitor.stream()
    for chunk in chunks(of, rows):
        stream.push(chunk)
    return stream


def _truth(random, samples, period_s):
    time_s = np.arange(samples + 2) * period_s

    def wave(size, *frequencies):
        return sum(size * np.sin(f * time_s + random.uniform(0, 6)) for f in frequencies)

    phi, theta, psi = wave(6.0, 0.9, 2.3), 3.0 + wave(2.0, 1.3, 3.1), 45.0 + wave(4.0, 0.7, 1.9)
    angles = gb.Record(np.column_stack([phi, theta, psi]), channels=["phi", "theta", "psi"], sample_period_s=period_s)
    rates = gb.derive(angles, ["p_att", "q_att", "r_att"]).matrix(["p_att", "q_att", "r_att"])[1:-1]
    others = [3.0 + wave(0.5, 1.1), wave(0.8, 1.7), wave(0.05, 0.6), 1.0 + wave(0.1, 2.1), 100.0 + wave(1.0, 0.3)]
    columns = [*rates.T, phi[1:-1], theta[1:-1], psi[1:-1], *(other[1:-1] for other in others)]
    return gb.Record(np.column_stack(columns), channels=NAMES, sample_period_s=period_s)


@cache
def monitor(bank="C"):
    """Return a monitor of a shipped bank."""
    return shared(
        f"made-up-{bank}",
        lambda: gb.calibrate(
            [record(seed=seed) for seed in range(1, 4)], bank=gb.load_bank(bank), provenance={"a": [1, "b"]}
        ),
    )


def shared(name, make):
    """Return a monitor that is calibrated once a session: its processes share its file."""
    if artefacts().flights is None:  # there is one process
        return make()
    path = artefacts().flights / f"{name}.json"
    path.parent.mkdir(mode=0o700, exist_ok=True)
    with FileLock(path.with_suffix(".lock")):
        if not path.is_file():
            gb.save_monitor(make(), path)
    return gb.load_monitor(path)
