"""What to fly next: the cheapest motion by which sensors are judged that a log doesn't judge.

Each motion is tried on paper: the attitude goes its way, gyros read what it turns by and what they were off by in this
log, stretch by stretch, louder where the motion is livelier; and where a log of that would be clear is told by the same
function that tells it of every log. So nothing but this log's own errors decides what is enough.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from gtmbench.engine.blocks import Blocks, rates_deg_s
from gtmbench.engine.flight import Flight
from gtmbench.engine.hindsight.alignment import alignment_of
from gtmbench.engine.hindsight.cleared_sensors import JUDGED, hindsight_of
from gtmbench.values.channels import ATTITUDE, GYROS, axis_of
from gtmbench.values.record import FloatArray
from gtmbench.verdict.scope import Scope
from gtmbench.verdict.timeline import State, laid_out
from gtmbench.verdict.verdict import LogVerdict, verdict_of

_LONG_S = (30.0, 60.0, 120.0, 240.0)  # tried, each twice as long
_RATES_DEG_S = (5.0, 10.0, 20.0)  # tried, each twice as fast
_PERIOD_S = 6.0  # of rolling and pitching
_DRAWS = 3  # of them; the worst counts
_SPARE = 1.25  # times the worst of these: what is promised
_OF_RATE = 0.01  # of the rates: what gyros are off by at least where the motion is livelier than in this log
_G_M_S2, _SPEED_M_S = 9.81, 20.0  # by which a turn banks an aircraft: at a small one's speed
_MOVES_DEG_S = 0.5  # by which a gyro's own axis has to turn to and fro
_FEWEST = 50  # blocks whose errors are known


@dataclass(frozen=True, kw_only=True)
class Manoeuvre:
    """A motion that can be flown."""

    how: str  # in words, ``{rate}`` for how fast
    duration_s: float
    rate_deg_s: float
    axes: tuple[float, float, float]  # of rolling, pitching and turning: which take part

    @property
    def text(self) -> str:
        """What is flown, in words."""
        return f"{self.duration_s:.0f} s of {self.how.format(rate=f'{self.rate_deg_s:.0f} deg/s')}"

    @property
    def cost(self) -> float:
        """By what motions are compared: seconds, more where they are hard."""
        return self.duration_s * (1.0 + 0.02 * self.rate_deg_s * sum(self.axes))

    def angles(self, time_s: FloatArray) -> FloatArray:
        """Return phi, theta and psi at some times, in deg, shape (times, 3)."""
        turns = 2.0 * np.pi * time_s / _PERIOD_S
        swing = self.rate_deg_s * _PERIOD_S / (2.0 * np.pi)
        roll, pitch, yaw = self.axes
        bank = yaw * np.degrees(np.arctan(np.radians(self.rate_deg_s) * _SPEED_M_S / _G_M_S2))
        phi = roll * swing * np.sin(turns) + bank
        theta = pitch * swing * np.sin(turns / np.sqrt(2.0))  # never in step with the rolling
        return np.column_stack([phi, theta + 0.0 * time_s, yaw * self.rate_deg_s * time_s])


@dataclass(frozen=True, kw_only=True)
class NextMotion:
    """A motion, the sensors that it lets be judged, and to which sizes."""

    motion: Manoeuvre
    sizes: Mapping[str, float]  # by sensor: the error that would show, in the sensor's unit

    @property
    def text(self) -> str:
        """In words.

        >>> told = Manoeuvre(how="full turns at {rate}", duration_s=60.0, rate_deg_s=10.0, axes=(0.0, 0.0, 1.0))
        >>> NextMotion(motion=told, sizes={"r": 0.93, "psi": 2.0}).text
        '60 s of full turns at 10 deg/s let r, psi be judged to 0.93 deg/s, 2 deg'
        """
        worst = {
            unit: max(size for sensor, size in self.sizes.items() if sensor in names)
            for unit, names in (("deg/s", GYROS), ("deg", ATTITUDE))
            if {*names} & self.sizes.keys()
        }
        to = ", ".join(f"{size:.2g} {unit}" for unit, size in worst.items())
        return f"{self.motion.text} let {', '.join(self.sizes)} be judged to {to}"


def motions() -> Iterator[Manoeuvre]:
    """Give motions that can be flown."""
    hows = (
        ("rolling left and right at up to {rate}", (1.0, 0.0, 0.0)),
        ("pitching up and down at up to {rate}", (0.0, 1.0, 0.0)),
        ("full turns at {rate}", (0.0, 0.0, 1.0)),
        ("rolling and pitching at up to {rate}, in full turns", (1.0, 1.0, 1.0)),
    )
    for how, axes in hows:
        for duration_s in _LONG_S:
            yield from (Manoeuvre(how=how, duration_s=duration_s, rate_deg_s=rate, axes=axes) for rate in _RATES_DEG_S)


def next_motions(flight: Flight, verdict: LogVerdict) -> tuple[NextMotion, ...]:
    """Return the cheapest motions by which the sensors are judged that a log's verdict leaves open.

    None for sensors that failed, or whose partner about their axis did, that part from the attitude, or that no motion
    of four minutes would clear.

    `flight`: of the log. `verdict`: on it.
    """
    error = alignment_of(flight.blocks).error  # what each gyro is off by, block by block, shape (blocks, 3)
    errors = error[np.isfinite(error).all(axis=1)]
    accused = {name for name in JUDGED if verdict.timeline.of(name, State.FAILED, State.SUSPECTED)}
    # where it, or who shares its axis, is accused no motion tells of it, but a sensor that is mended
    todo = [name for name in verdict.unjudged if name in JUDGED and not accused & {*axis_of(name)}]
    if len(errors) < _FEWEST or not todo:
        return ()
    found: dict[Manoeuvre, dict[str, float]] = {}
    for motion in sorted(motions(), key=lambda motion: motion.cost):
        sizes = _sizes(flight, errors, motion, replace(verdict.scope, sensors=tuple(todo)))
        if sizes:
            found[motion] = sizes
            todo = [name for name in todo if name not in sizes]
        if not todo:
            break
    return tuple(NextMotion(motion=motion, sizes=sizes) for motion, sizes in found.items())


def _sizes(flight: Flight, errors: FloatArray, motion: Manoeuvre, scope: Scope) -> dict[str, float]:
    """Return the sensors that a motion lets be judged, and to which sizes: the worst of some draws of errors."""
    worst = dict.fromkeys(scope.sensors, 0.0)
    for draw in range(_DRAWS):
        blocks = _flown(flight, errors, motion, np.random.default_rng([74, draw]))
        if scope.factor is not None:  # a steady turn tells no factor from an offset
            still = {gyro for gyro, moves in zip(GYROS, blocks.rates.std(axis=0), strict=True) if moves < _MOVES_DEG_S}
            worst = {name: size for name, size in worst.items() if name not in still}
        span_s = (0.0, blocks.end_s)
        claims = hindsight_of(blocks, is_driven=flight.is_driven, is_sure=not flight.is_assumed).claims
        verdict = verdict_of(laid_out(span_s, claims, motion_s=[span_s]), scope)
        sizes = {name: verdict.sizes_of(name) for name in worst if name not in verdict.unjudged}
        worst = {name: max(worst[name], _SPARE * each.error) for name, each in sizes.items() if each is not None}
        worst = {name: size for name, size in worst.items() if size <= scope.limit_of(name)}
        if not worst:
            break
    return worst


def _flown(flight: Flight, errors: FloatArray, motion: Manoeuvre, random: np.random.Generator) -> Blocks:
    """Return the blocks of a log of a motion."""
    period_s = flight.blocks.period_s
    count = round(motion.duration_s / period_s)
    angles = motion.angles(np.asarray(period_s * np.arange(count + 1), dtype=np.float64))
    rates = rates_deg_s(angles, period_s)
    piece = max(min(round(5.0 / period_s), len(errors)), 1)  # pieces of this log's errors are put one after another
    starts = random.integers(0, len(errors) - piece + 1, -(-count // piece))
    off = np.concatenate([errors[start : start + piece] for start in starts])[:count]
    lively = float(np.sqrt(np.nanmean(np.square(rates).sum(axis=1))))
    usual = float(np.median(flight.lively[flight.judged])) if flight.judged.any() else lively
    louder = _OF_RATE * max(lively - usual, 0.0) * random.standard_normal(off.shape)
    rough = flight.blocks.rough[np.isfinite(flight.blocks.rough).all(axis=1)]
    shaken = rough[random.integers(0, len(rough), count)] if len(rough) else np.zeros((count, 3))
    return Blocks(
        start_s=0.0,
        period_s=period_s,
        gyros=rates + off + louder,
        rates=rates,
        euler_rates=np.diff(angles, axis=0) / period_s,
        angles=angles[:-1],
        rough=shaken,
        held_s=np.zeros((count, 6)),
    )
