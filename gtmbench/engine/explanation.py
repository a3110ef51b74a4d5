"""An explanation of errors: who, what kind, what it does to the readings, its price and its bounds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from gtmbench.engine.flight import Flight
from gtmbench.engine.relation import Effect, on_axis
from gtmbench.values.attitude_estimators import filtered
from gtmbench.values.channels import GYROS
from gtmbench.values.record import FloatArray

TIMES_S = (2.5, 7.0, 16.0)  # time constants of an estimator that the gyros drive; what lies between is near one of them


@dataclass(frozen=True, kw_only=True, eq=False)
class Explanation:
    """An explanation, linear in its size."""

    suspect: str  # the sensor that is off, or what a healthy cause is called
    kind: str
    # from a flight to what readings are off by at size one, had it been there since the log began
    effect: Callable[[Flight], Effect] = field(repr=False)
    # the time constant by which the attitude forgets what was before the onset; 0 of one that doesn't follow
    fades_s: float = 0.0
    price: float = 0.0  # minus the log of its odds a priori, in nats; infinite where it can't be
    # low, high: between what a size has to be
    low: float = -np.inf
    high: float = np.inf
    reach: float = np.inf  # the most that a size times the seconds since the onset may be
    least: float = 0.0  # what is smaller is no failure
    shortest_s: float = 0.0  # in less, its shape is another one's, or chance's
    is_healthy: bool = False  # whether nothing failed
    axes: tuple[int, ...] = ()  # of what is no sensor's: which gyros and angles aren't judged where it holds
    is_gain: bool = False  # whether it needs motion to show
    of_turns: bool = False  # whether it is a share of what the attitude turns, and not of what is read
    mirror: float = np.nan  # the size at which a gyro's own noise explains itself; NaN for none
    lasts: bool = True  # whether every part of a window has to show it: a gust is in one part alone
    # from a flight to what grows with time, shape (blocks,): its value at the onset times the effect of `base` is taken
    # off
    since: Callable[[Flight], FloatArray] | None = field(default=None, repr=False)
    base: str = ""  # the name of the explanation that is meant

    @property
    def name(self) -> str:
        """Who, what, and behind which estimator."""
        return name_of(self.suspect, self.kind, self.fades_s)


def name_of(suspect: str, kind: str, fades_s: float = 0.0) -> str:
    """Return the name of an explanation.

    >>> name_of("q", "bias"), name_of("q", "bias", 2.5)
    ('q bias', 'q bias (2.5 s)')
    """
    return f"{suspect} {kind}" + (f" ({fades_s:g} s)" if fades_s else "")


def of_gyros(
    kind: str, wrong: Callable[[Flight, int], FloatArray], *, base: str = "", **bounds: object
) -> list[Explanation]:
    """Return explanations of each gyro: an attitude that doesn't follow it, and one that does through an estimator.

    `wrong`: from a flight and an axis to what the gyro is off by at size one, in deg/s, shape (blocks,). `base`: the
    kind that it grows from, of the same gyro behind the same estimator. `bounds`: of `Explanation`.
    """
    found = []
    for fades_s in (0.0, *TIMES_S):
        for axis, gyro in enumerate(GYROS):
            effect = partial(_of_gyro, wrong=wrong, axis=axis, fades_s=fades_s, is_gain=bool(bounds.get("is_gain")))
            of = name_of(gyro, base, fades_s) if base else ""
            found.append(Explanation(suspect=gyro, kind=kind, effect=effect, fades_s=fades_s, base=of, **bounds))  # type: ignore[arg-type]
    return found


def _of_gyro(
    flight: Flight, *, wrong: Callable[[Flight, int], FloatArray], axis: int, fades_s: float, is_gain: bool
) -> Effect:
    """Return what a gyro's error does: e' = C f - e / tau, e the attitude's in earth axes."""
    own = on_axis(wrong(flight, axis), axis)
    gyros, gains = (None, own) if is_gain else (own, None)
    if not fades_s:
        return Effect(gyros=gyros, gains=gains)
    turned, turning = followed(flight, own, fades_s)
    return Effect(gyros=gyros, gains=gains, turned=turned, turning=turning)


def seconds(flight: Flight) -> FloatArray:
    """Return the time since the log began, at each block's beginning: what grows is less by that of its onset."""
    return flight.time_s - 0.5 * flight.blocks.period_s


def kept_a_block(flight: Flight, fades_s: float) -> float:
    """Return how much of what it was off by an attitude still is a block later."""
    return 1.0 - flight.blocks.period_s / fades_s


def followed(flight: Flight, wrong: FloatArray, fades_s: float) -> tuple[FloatArray, FloatArray]:
    """Return how far an estimator's attitude is off that wrong rates drive, behind each block, and how fast it turns.

    `wrong`, shape (blocks, 3): in body axes, deg/s. `fades_s`: its time constant.
    """
    step = flight.blocks.period_s
    driven = np.einsum("nij,nj->ni", flight.matrices, wrong)
    before = np.zeros_like(driven)
    turned = filtered([step], [1.0, -kept_a_block(flight, fades_s)], driven)
    before[1:] = turned[:-1]
    return turned, driven - 0.5 * (before + turned) / fades_s  # amid each block
