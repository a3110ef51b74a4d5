"""An unstable plant inside a stabilising loop, Fig. 3.6, and where noise enters it."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from gtmbench.checks import number, whole
from gtmbench.errors import InputError
from gtmbench.values.record import FloatArray, Record
from theory.state_space import StateSpace

Noise = Literal["process", "measured", "input", "output"]


def closed_loop(plant: StateSpace, gain: FloatArray) -> StateSpace:
    """Return the loop u0 = c - K x of Fig. 3.6, as a system from (c, v) to (u0, y0).

    v is process noise: the plant is driven by u0 + v.

    Raises
    ------
    InputError
        Where the gain has another shape than (inputs, states).
    """
    A, B, C, D = plant.A, plant.B, plant.C, plant.D
    if np.shape(gain) != B.T.shape:
        raise InputError(f"the gain has shape {np.shape(gain)}; for {plant} it has {B.T.shape}")
    return StateSpace(
        A=A - B @ gain,
        B=np.hstack([B, B]),
        C=np.vstack([-gain, C - D @ gain]),
        D=np.block([[np.eye(plant.inputs), np.zeros((plant.inputs, plant.inputs))], [D, D]]),
    )


def loop_records(
    plant: StateSpace,
    gain: FloatArray,
    *,
    samples: int,
    runs: int = 1,
    snr: float | None = None,
    noise: Noise = "process",
    seed: int = 0,
) -> tuple[Record, ...]:
    """Simulate the loop from rest, excited by c, white and N(0, 1); return one record a run.

    Parameters
    ----------
    plant : StateSpace
    gain : array, shape (inputs, states)
        K.
    samples, runs : int
    snr : float, optional
        Signal-to-noise ratio, a ratio of powers (chapter 3): white noise v of so much less power than what it is added
        to (c for process noise, u0 or y0 for a sensor's). None: no noise.
    noise : str
        Where v enters, which decides who is biased:
        "process", into the plant behind the place where u0 is measured, SNR against c: the one that reproduces the
        figures; "measured", the same with u0 + v measured, which leaves the data exact; "input", (3.38), and "output",
        (3.39), into what is measured of u0 or y0 only.
    seed : int
        A run of a seed is the same whatever `runs` is.

    Returns
    -------
    tuple of Record
        Channels c, u, y (c0, c1, u0, ... where there are several), sample period 1 s.

    Raises
    ------
    InputError
        For another noise, a gain of another shape, a loop that isn't stable.

    Examples
    --------
    >>> from theory.plants import example_3_1
    >>> example = example_3_1()
    >>> loop_records(example.plant, example.gain, samples=50)[0].channels
    ('c0', 'c1', 'u0', 'u1', 'y0', 'y1')
    """
    if noise not in get_args(Noise):
        raise InputError(f"noise is {noise!r}; it enters as one of {', '.join(get_args(Noise))}")
    whole("samples", samples, 1)
    loop = closed_loop(plant, gain)
    radius = float(np.abs(loop.poles).max(initial=0.0))
    if radius >= 1.0:
        raise InputError(
            f"the loop has a pole of magnitude {radius:.6g}, so its signals grow; give a gain that stabilises it"
        )
    m = plant.inputs
    draws = np.array(
        [
            np.random.default_rng([seed, run]).standard_normal((samples, 2 * m + plant.outputs))
            for run in range(whole("runs", runs, 1))
        ]
    )
    c, v, w = draws[..., :m], draws[..., m : 2 * m], draws[..., 2 * m :]
    std = 0.0 if snr is None else number("snr", snr, 0.0, above=True) ** -0.5
    enters = std * v if noise in ("process", "measured") else np.zeros_like(v)
    measured = loop.simulate(np.concatenate([c, enters], axis=-1))
    u, y = measured[..., :m], measured[..., m:]
    if noise == "measured":
        u = u + enters
    elif noise == "input":
        u = u + std * u.std(axis=-2, keepdims=True) * v
    elif noise == "output":
        y = y + std * y.std(axis=-2, keepdims=True) * w
    names = [*channels("c", m), *channels("u", m), *channels("y", plant.outputs)]
    return tuple(Record(values, channels=names, sample_period_s=1.0) for values in np.concatenate([c, u, y], axis=-1))


def channels(letter: str, count: int) -> tuple[str, ...]:
    """Return the names of a vector's channels: ``y``, or ``y0``, ``y1``, ...

    >>> channels("u", 1), channels("y", 2)
    (('u',), ('y0', 'y1'))
    """
    return (letter,) if count == 1 else tuple(f"{letter}{i}" for i in range(count))
