"""An aircraft whose answer to its commands is linear and known, in gusts: seconds of it cost milliseconds."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from gtmbench.values.record import FloatArray, Record

STEP_S, ALPHA_DEG, SPEED_KT = 0.02, 3.0, 100.0
Broken = Callable[[FloatArray], FloatArray]


def answering(
    *,
    duration_s: float = 160.0,
    seed: int = 1,
    surfaces: Mapping[str, Broken] | None = None,
    speed: FloatArray | None = None,
    liveliness: FloatArray | float = 1.0,
) -> Record:
    """Return what is read of a flight, commands among it.

    Parameters
    ----------
    duration_s : float
    seed : int
    surfaces : mapping of surface to callable
        What becomes of its command on the way to the aircraft.
    speed : shape (samples,), optional
        In kt; what answers grows with its square, and nothing does where it is low.
    liveliness : shape (samples,), optional
        By which commands are multiplied.
    """
    random, count = np.random.default_rng(seed), round(duration_s / STEP_S)
    speed = np.full(count, SPEED_KT) if speed is None else speed
    pressure = np.square(speed / SPEED_KT)
    moved = ("elevator", "aileron", "rudder")
    commands = {name: liveliness * _commanded(random, count) for name in moved}
    commands["throttle"] = np.full(count, 40.0)
    made = {name: (surfaces or {}).get(name, lambda command: command)(commands[name]) for name in moved}
    gusts = np.cumsum(random.standard_normal((count, 2)), axis=0) * 0.02
    gusts -= np.array([np.convolve(each, np.ones(500) / 500.0, "same") for each in gusts.T]).T
    states = np.zeros((count, 5))  # p, q, r, alpha, beta
    for row in range(count - 1):
        p, q, r, alpha, beta = states[row]
        air, (up, side) = pressure[row], gusts[row]
        e, a, d = (made[name][row] for name in ("elevator", "aileron", "rudder"))
        rates = air * np.array(
            [
                -80.0 * a + 8.0 * d - 40.0 * (beta + side) - 6.0 * p,
                -60.0 * e - 30.0 * (alpha + up) - 5.0 * q,
                -4.0 * a - 40.0 * d + 30.0 * (beta + side) - 3.0 * r,
            ]
        )
        flow = np.array([q - 3.0 * alpha, -r - 1.0 * beta])
        states[row + 1] = states[row] + STEP_S * np.append(rates, flow)
    vanes = states[:, 3:] + gusts
    e, d = made["elevator"], made["rudder"]
    read = {
        **dict(zip("pqr", states.T, strict=False)),
        "alpha": ALPHA_DEG + vanes[:, 0],
        "beta": vanes[:, 1],
        "phi": STEP_S * np.cumsum(states[:, 0]),
        "theta": ALPHA_DEG + STEP_S * np.cumsum(states[:, 1]),
        "psi": STEP_S * np.cumsum(states[:, 2]),
        "nx": np.full(count, 0.05),
        "ny": pressure * (0.01 * d - 0.05 * vanes[:, 1]),
        "nz": pressure * (1.0 + 0.15 * vanes[:, 0] + 0.02 * e),
        "tas": speed,
        "altitude": np.full(count, 1000.0),
    }
    noise = {"alpha": 0.05, "beta": 0.05, "nx": 0.003, "ny": 0.003, "nz": 0.005, "tas": 0.3, "altitude": 1.0}
    values = {name: of + noise.get(name, 0.03) * random.standard_normal(count) for name, of in read.items()} | commands
    return Record(np.column_stack([*values.values()]), channels=[*values], sample_period_s=STEP_S)


def _commanded(random: np.random.Generator, count: int) -> FloatArray:
    """Return steps of random sizes, one in six tenths of a second on average, as a servo follows them."""
    steps = np.cumsum(random.random(count) < STEP_S / 0.6)
    sizes = 1.5 * random.standard_normal(steps[-1] + 1)
    return np.convolve(sizes[steps], np.ones(10) / 10.0, "same")
