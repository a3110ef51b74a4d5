"""A surface told from a sensor of the flow: by what a wrong sensor would have left beside the deviation.

An angle of attack that is wrong by a degree looks like an elevator that is off by half a degree, and leaves the other
equations ten deviations wrong; an elevator leaves nothing. So every sensor of the flow is a hypothesis: it would have
changed what is left by rho times the deviation's change, in the same windows and by the same regressors. The margin is
the logarithm of the likelihood ratio between "nothing is left" and that, in nats: large if the sensor would have been
seen and wasn't, near zero where nobody could have seen it, and negative where it was.
"""

from __future__ import annotations

import numpy as np

from gtmbench.detectors.surfaces.answer import Answer, solved
from gtmbench.detectors.surfaces.deviation import ANSWER, KINDS, Changes
from gtmbench.detectors.surfaces.thrust import THROTTLE
from gtmbench.detectors.surfaces.usual import Normal
from gtmbench.values.record import FloatArray

_KNOWN_TO = 0.25  # of rho: effects vary with the angle of attack
_LEAVES = 0.1  # of what a sensor would leave: as much a surface may, for no effect is quite linear
_LEAST = 1e-9  # a division's guard


def ratios(answer: Answer) -> FloatArray:
    """Return rho, shape (sensors, surfaces, left): what a wrong sensor changes of what is left, by degree of a surface.

    Sensors are the accelerometers across, which an equation explains, and the vanes, which explain.
    """
    equations = list(answer.equations)
    wrong = np.zeros((len(answer.frame.sensors), len(equations)))
    for number, sensor in enumerate(answer.frame.sensors):
        if sensor in equations:
            wrong[number, equations.index(sensor)] = 1.0
        else:
            wrong[number] = [-answer.effect(equation, sensor) for equation in equations]
    to_off, to_left = solved(answer)
    off, left = wrong @ to_off.T, wrong @ to_left.T
    return np.asarray(left[:, np.newaxis, :] / np.where(np.abs(off) < _LEAST, _LEAST, off)[..., np.newaxis])


def throttle_ratios(answer: Answer) -> FloatArray:
    """Return what a wrong alpha and a wrong airspeed change of what is left, by a step of throttle; (sensors, left)."""
    place, alpha = answer.surfaces.index(THROTTLE), answer.frame.sensors.index("alpha")
    to_off, to_left = solved(answer)
    by_airspeed = to_left @ answer.by_airspeed / (to_off @ answer.by_airspeed)[place]
    return np.array([ratios(answer)[alpha, place], by_airspeed])


def margins(found: Changes, normal: Normal, rho: FloatArray) -> FloatArray:
    """Return by how many nats a surface explains its change better than any sensor of the flow would.

    `rho`, shape (sensors, surfaces, left). Returns shape (blocks, tests, surfaces): 0, which decides nothing, where no
    vanes stand beside accelerometers.
    """
    sensors, surfaces, left = rho.shape
    shape = (*found.size.shape[:2], surfaces)
    if not sensors or not left:
        return np.zeros(shape)
    of_answer = np.array([kind == ANSWER for kind in KINDS])[:, np.newaxis, np.newaxis]
    spread = found.spread * np.square(normal.colour)[..., np.newaxis, np.newaxis]
    least = np.full(shape, np.inf)
    for surface in range(surfaces):
        alone = slice(surfaces, surfaces + left)
        first = surfaces + left * (1 + surface)
        crossed = slice(first, first + left)
        change = np.where(of_answer, found.fit[:, :, crossed], found.fit[:, :, alone])
        own = np.where(of_answer[..., np.newaxis], spread[:, :, crossed], spread[:, :, alone])
        seen, unsure = found.fit[:, :, [surface]], spread[:, :, [surface]]
        for ratio in rho[:, surface]:
            told = ratio[:, np.newaxis] * seen
            of_sensor = own + _outer(_KNOWN_TO * told) + np.square(ratio)[:, np.newaxis, np.newaxis] * unsure
            of_surface = own + _outer(_LEAVES * told)
            nats = 0.5 * (_squared(change - told, of_sensor) - _squared(change, of_surface)).sum(axis=-1)
            least[..., surface] = np.fmin(least[..., surface], nats)
    return least


def _outer(change: FloatArray) -> FloatArray:
    return change[..., :, np.newaxis] * change[..., np.newaxis, :]


def _squared(change: FloatArray, spread: FloatArray) -> FloatArray:
    """Return change' spread^-1 change; a test of one parameter has the other at 0."""
    a, b, c = spread[..., 0, 0], spread[..., 0, 1], spread[..., 1, 1]
    x, y = change[..., 0], change[..., 1]
    single = c <= 0.0
    c = np.where(single, 1.0, c)
    return np.asarray((c * x**2 - 2.0 * b * x * y + a * y**2) / np.maximum(a * c - b**2, _LEAST**2))
