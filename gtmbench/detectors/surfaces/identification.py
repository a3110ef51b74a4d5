"""The aircraft's answer identified from healthy flight, in gusts and with a controller in the loop.

Least squares on the equations as they stand would find ailerons a quarter as effective as they are: a gust that rolls
the aircraft is mixed up with the roll rate that it makes, and with the ailerons that a controller then moves. So causes
of one step explain the change until the next, in noise that is made white (`whitened.py`): what is new in it owes
nothing to anything before.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gtmbench.detectors.surfaces.answer import Answer
from gtmbench.detectors.surfaces.equations import (
    OWN_SURFACES,
    THROTTLE,
    Engine,
    Flow,
    Frame,
    Regressing,
    Sides,
    causes_beside,
)
from gtmbench.detectors.surfaces.whitened import ORDER, whitening
from gtmbench.errors import InputError
from gtmbench.values.channels import COMMANDS, GYROS, SURFACES
from gtmbench.values.record import FloatArray

_SERVO_LAGS_S, _ENGINE_LAGS_S = (0.02, 0.04, 0.07, 0.12, 0.2), (0.3, 1.0, 2.5)  # of servos and engines: tried
_TWICE_LAGS_S = (0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 1.0, 1.2, 1.5, 2.0, 3.0)  # of engines that are judged: two in a row
_BENDS = tuple(np.arange(-0.75, 4.1, 0.25).tolist())  # and how far from proportional their thrust is
_LEAST_SLOPE = 0.1  # of thrust by throttle: with less, a lag and a bend aren't told
SETTLES_S = 5.0  # until filters have settled: five lags of the dynamic pressure
_MOVED_DEG, _MOVED_PERCENT = 0.1, 1.0  # deviation that a command must have had to be identified
STEP_S = 0.05  # from causes to what they change, where effects are identified
_TURNS = 12  # of fitting effects and making their noise white


def identified(flow: Flow, records: Sequence[FloatArray], sample_period_s: float) -> Answer:
    """Identify the answer on healthy records, each of shape (samples, channels).

    InputError where no surface ever moved.
    """
    frame = frame_of(flow, records, sample_period_s)
    theta, _ = _fitted(frame, tuple(frame.equations), records, sample_period_s)
    return Answer(
        frame=frame,
        theta=theta,
        covariance=_covariance(frame, theta, records, sample_period_s),
    )


def frame_of(flow: Flow, records: Sequence[FloatArray], sample_period_s: float) -> Frame:
    """Return what the equations are written in, by records: which surfaces move, how late servos and engines follow.

    InputError where no surface ever moved.
    """
    at = {name: i for i, name in enumerate((*GYROS, *flow.channels, *COMMANDS))}
    spread = {name: max(float(np.nanstd(values[:, at[name]])) for values in records) for name in COMMANDS}
    moved = tuple(name for name in SURFACES if spread[name] >= _MOVED_DEG)
    if not moved:
        raise InputError(
            f"no command of {', '.join(SURFACES)} moves in the healthy records, so nothing is known of what they do; "
            "give flights that somebody flies, or with an excitation"
        )
    if flow.forward and spread[THROTTLE] >= _MOVED_PERCENT:
        moved = (*moved, THROTTLE)

    def usual(name: str) -> float:
        return float(np.nanmedian(np.concatenate([values[:, at[name]] for values in records])))

    reference = max(abs(usual("tas")), 1e-6) if flow.airspeed else 1.0
    engine = Engine(lag_s=_ENGINE_LAGS_S[1])
    frame = Frame(
        flow=flow,
        surfaces=moved,
        servo_s=_SERVO_LAGS_S[0],
        engine=engine,
        reference=reference,
    )

    def left(tried: Frame, *names: str) -> float:
        return _fitted(tried, names or tuple(frame.equations), records, sample_period_s)[1]

    if THROTTLE in moved:
        engine = _engine(replace(frame, engine=Engine(lag_s=1.0, lags=2, level=usual(THROTTLE))), left)
        frame = replace(frame, engine=engine)
    frame = min((replace(frame, servo_s=lag_s) for lag_s in _SERVO_LAGS_S), key=left)
    if THROTTLE not in moved:
        engines = [replace(engine, lag_s=lag_s) for lag_s in _ENGINE_LAGS_S]
        frame = min((replace(frame, engine=tried) for tried in engines), key=left)
    return frame


def _engine(frame: Frame, left: Callable[..., float]) -> Engine:
    """Return the engine whose thrust leaves least of the forward acceleration: its lag and its bend by turns."""
    for _ in range(2):
        for key, values in (("lag_s", _TWICE_LAGS_S), ("bend", _BENDS)):
            tried = [replace(frame, engine=replace(frame.engine, **{key: value})) for value in values]
            frame = min((each for each in tried if each.engine.slope > _LEAST_SLOPE), key=lambda each: left(each, "nx"))
    return frame.engine


def _fitted(
    frame: Frame, names: Sequence[str], records: Sequence[FloatArray], period_s: float
) -> tuple[dict[str, FloatArray], float]:
    """Return the effects, and what is left unpredicted: the logarithm of its power, of some equations.

    Gusts drive what they are mixed up with: a gust that rolls the aircraft changes the roll rate, and a controller
    then moves the ailerons. So causes of one step explain the change to the next, and noise is made white: what is
    new in it owes nothing to anything before.
    """
    made = [Regressing(frame, period_s).sides(values[round(SETTLES_S / period_s) :]) for values in records]
    theta, cost = {}, 0.0
    for name in names:
        parts = [steps_of(frame, name, sides, period_s) for sides in made]
        effects = in_coloured_noise(parts)
        theta[name] = np.zeros(len(frame.surfaces) + causes_beside(frame.equations[name], frame.surfaces))
        theta[name][causes_of(frame, name)] = effects.theta
        power = np.mean(np.square(np.concatenate([effects.white(left) for left in effects.lefts])))
        cost += float(np.log(max(float(power), 1e-300)))
    return theta, cost


def causes_of(frame: Frame, name: str) -> list[int]:
    """Return which causes an equation has: the surfaces that are its own, then all others."""
    axis, surfaces = frame.equations[name], len(frame.surfaces)
    own = [i for i, surface in enumerate(frame.surfaces) if surface in OWN_SURFACES[axis]]
    return [*own, *range(surfaces, surfaces + causes_beside(axis, frame.surfaces))]


def steps_of(frame: Frame, name: str, sides: Sides, period_s: float) -> FloatArray:
    """Return an equation's causes step by step, and last what is explained: of a gyro, its change until the next."""
    rows = max(round(STEP_S / period_s), 1)
    causes = means_of(sides.causes[frame.equations[name]][:, causes_of(frame, name)], rows)
    explained = means_of(sides.explained[name], rows)
    if name in GYROS:
        causes, explained = causes[:-1], np.diff(explained, axis=0) / (rows * period_s)
    return np.column_stack([causes, explained])


def means_of(values: FloatArray, rows: int) -> FloatArray:
    """Return the means of every so many rows; what is left over at the end isn't used."""
    count = len(values) // rows
    return np.asarray(values[: count * rows].reshape(count, rows, -1).mean(axis=1))


class SurfaceEffects(NamedTuple):
    """The effects of causes: theta, what they leave of each part, and the filter that makes it white."""

    theta: FloatArray
    lefts: list[FloatArray]
    taps: FloatArray

    def white(self, columns: FloatArray) -> FloatArray:
        """Return columns made white, but for the first rows, for which the filter has no past."""
        from scipy.signal import lfilter

        return np.asarray(lfilter(self.taps, [1.0], columns, axis=0)[ORDER:])


def in_coloured_noise(parts: Sequence[FloatArray]) -> SurfaceEffects:
    """Return the effects of causes by least squares, the last column being what is explained."""
    effects = SurfaceEffects(theta=np.zeros(parts[0].shape[1] - 1), lefts=[], taps=np.ones(1))
    for _ in range(_TURNS):
        white = np.concatenate([effects.white(part) for part in parts])
        scale = np.maximum(np.sqrt(np.mean(np.square(white), axis=0)), 1e-12)
        found = np.linalg.lstsq(white[:, :-1] / scale[:-1], white[:, -1], rcond=1e-8)[0] / scale[:-1]
        lefts = [part[:, -1] - part[:, :-1] @ found for part in parts]
        lagged = [sum(float(each[lag:] @ each[: len(each) - lag]) for each in lefts) for lag in range(ORDER + 1)]
        effects = SurfaceEffects(theta=np.asarray(found), lefts=lefts, taps=whitening(np.array(lagged)))
    return effects


def _covariance(
    frame: Frame, theta: Mapping[str, FloatArray], records: Sequence[FloatArray], period_s: float
) -> FloatArray:
    """Return S: the covariance of what the equations leave behind the lag; nx by itself."""
    step, begun = max(round(STEP_S / period_s), 1), round(SETTLES_S / period_s)
    left = []
    for values in records:
        made = Regressing(frame, period_s).push(values)
        left.append(
            [made.explained[name][begun::step] - made.regressors[name][begun::step] @ of for name, of in theta.items()]
        )
    covariance = np.atleast_2d(np.cov(np.concatenate([np.array(each) for each in left], axis=1), bias=True))
    alone = np.array([axis == "forward" for axis in frame.equations.values()])
    apart = (alone[:, np.newaxis] | alone) & ~np.eye(len(alone), dtype=bool)
    return np.where(apart, 0.0, covariance)
