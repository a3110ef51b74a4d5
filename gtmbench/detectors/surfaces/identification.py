"""The aircraft's answer identified from healthy flight, in gusts and with a controller in the loop.

Least squares on the equations as they stand would find ailerons a quarter as effective as they are: a gust that rolls
the aircraft is mixed up with the roll rate that it makes, and with the ailerons that a controller then moves. So causes
of one step explain the change until the next, in noise that is made white (`whitened.py`): what is new in it owes
nothing to anything before.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from gtmbench.detectors.surfaces.answer import CAUSES, OWN_SURFACES, Answer, Flow, Regressing
from gtmbench.detectors.surfaces.whitened import ORDER, whitening
from gtmbench.errors import InputError
from gtmbench.values.channels import COMMANDS, GYROS, SURFACES
from gtmbench.values.record import FloatArray

_SURFACE_LAGS_S, _ENGINE_LAGS_S = (0.02, 0.04, 0.07, 0.12, 0.2), (0.3, 1.0, 2.5)  # of servos and engines: tried
_SETTLES_S = 5.0
_MOVED_DEG = 0.1  # deviation that a command must have had to be identified
_STEP_S = 0.05  # from causes to what they change, where effects are identified
_TURNS = 12  # of fitting effects and making their noise white


def identified(flow: Flow, records: Sequence[FloatArray], sample_period_s: float) -> Answer:
    """Identify the answer on healthy records, each of shape (samples, channels).

    Raises
    ------
    InputError
        Where no surface ever moved.
    """
    at = {name: i for i, name in enumerate((*GYROS, *flow.channels, *COMMANDS))}
    moved = tuple(
        name for name in SURFACES if max(float(np.nanstd(values[:, at[name]])) for values in records) >= _MOVED_DEG
    )
    if not moved:
        raise InputError(
            f"no command of {', '.join(SURFACES)} moves in the healthy records, so nothing is known of what they do; "
            "give flights that somebody flies, or with an excitation"
        )
    reference = (
        float(np.nanmedian(np.concatenate([values[:, at["tas"]] for values in records]))) if flow.airspeed else 1.0
    )
    reference = max(abs(reference), 1e-6)
    found = partial(_fitted, flow, moved, reference, records, sample_period_s)
    servo = min(_SURFACE_LAGS_S, key=lambda lag_s: found((lag_s, _ENGINE_LAGS_S[1]))[1])
    engine = min(_ENGINE_LAGS_S, key=lambda lag_s: found((servo, lag_s))[1])
    theta, _ = found((servo, engine))
    lags_s = (servo, engine)
    return Answer(
        flow=flow,
        surfaces=moved,
        lags_s=lags_s,
        theta=theta,
        covariance=_covariance(theta, flow, moved, lags_s, reference, records, sample_period_s),
        reference=reference,
    )


def _fitted(
    flow: Flow,
    surfaces: tuple[str, ...],
    reference: float,
    records: Sequence[FloatArray],
    period_s: float,
    lags_s: tuple[float, float],
) -> tuple[dict[str, FloatArray], float]:
    """Return the effects, and what is left unpredicted: the logarithm of its power, of all equations.

    Gusts drive what they are mixed up with: a gust that rolls the aircraft changes the roll rate, and a controller
    then moves the ailerons. So causes of one step explain the change to the next, and noise is made white: what is
    new in it owes nothing to anything before.
    """
    rows, begun = max(round(_STEP_S / period_s), 1), round(_SETTLES_S / period_s)
    made = [Regressing(flow, surfaces, lags_s, reference, period_s).sides(values[begun:]) for values in records]
    theta, cost = {}, 0.0
    for name, axis in flow.equations.items():
        own = [i for i, surface in enumerate(surfaces) if surface in OWN_SURFACES[axis]]
        used = [*own, *range(len(surfaces), len(surfaces) + CAUSES[axis])]
        parts = []
        for sides in made:
            causes, explained = _means(sides.causes[axis][:, used], rows), _means(sides.explained[name], rows)
            if name in GYROS:
                causes, explained = causes[:-1], np.diff(explained, axis=0) / (rows * period_s)
            parts.append(np.column_stack([causes, explained]))
        found = np.zeros(len(surfaces) + CAUSES[axis])
        found[used], power = _in_coloured_noise(parts)
        theta[name] = found
        cost += float(np.log(max(power, 1e-300)))
    return theta, cost


def _means(values: FloatArray, rows: int) -> FloatArray:
    count = len(values) // rows
    return np.asarray(values[: count * rows].reshape(count, rows, -1).mean(axis=1))


def _in_coloured_noise(parts: Sequence[FloatArray]) -> tuple[FloatArray, float]:
    """Return the effects of causes by least squares, the last column being what is explained, and the power left."""
    from scipy.signal import lfilter

    taps = np.ones(1)
    for _ in range(_TURNS):
        white = np.concatenate([lfilter(taps, [1.0], part, axis=0)[ORDER:] for part in parts])
        scale = np.maximum(np.sqrt(np.mean(np.square(white), axis=0)), 1e-12)
        found = np.linalg.lstsq(white[:, :-1] / scale[:-1], white[:, -1], rcond=1e-8)[0] / scale[:-1]
        lefts = [part[:, -1] - part[:, :-1] @ found for part in parts]
        lagged = [sum(float(each[lag:] @ each[: len(each) - lag]) for each in lefts) for lag in range(ORDER + 1)]
        taps = whitening(np.array(lagged))
    left = np.concatenate([lfilter(taps, [1.0], each)[ORDER:] for each in lefts])
    return np.asarray(found), float(np.mean(np.square(left)))


def _covariance(
    theta: Mapping[str, FloatArray],
    flow: Flow,
    surfaces: tuple[str, ...],
    lags_s: tuple[float, float],
    reference: float,
    records: Sequence[FloatArray],
    period_s: float,
) -> FloatArray:
    """Return S: the covariance of what the equations leave behind the lag."""
    step, begun = max(round(_STEP_S / period_s), 1), round(_SETTLES_S / period_s)
    left = []
    for values in records:
        made = Regressing(flow, surfaces, lags_s, reference, period_s).push(values)
        left.append(
            [made.explained[name][begun::step] - made.regressors[name][begun::step] @ of for name, of in theta.items()]
        )
    return np.atleast_2d(np.cov(np.concatenate([np.array(each) for each in left], axis=1), bias=True))
