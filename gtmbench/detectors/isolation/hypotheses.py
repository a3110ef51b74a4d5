"""Fault hypotheses: what a broken sensor adds to what it should have read, by how each kind says that it shows.

The same for gyros and angles, or the richer side wins. Linear ones are least squares in a few shapes; others try values
of one parameter on the fault's own class; noise is judged by its spectrum (`gtmbench.faults.shape`). A hypothesis
without a kind explains what nobody wrote one for: it names a sensor, and its kind is `unknown`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from gtmbench.detectors.isolation.fitter import UNKNOWN, WALKING, WORTH, Fit, Fitter, Parameters
from gtmbench.detectors.isolation.noise import NoiseFit, spikes_of
from gtmbench.detectors.isolation.search import ParameterSearch
from gtmbench.detectors.isolation.standing import quantum_of
from gtmbench.detectors.isolation.suspect import Left, Suspect
from gtmbench.faults.fault import Fault
from gtmbench.faults.registry import FAULTS, grows, loaded_faults
from gtmbench.faults.shape import CONSTANT, SHOWN, How, Shape

_REPLACED = 0.1  # of the signal, may be left of it
_SOON_S = 0.1  # behind the sure onset, for what may not begin before it
_FLIPPED = 0.1  # a gain that near -1 is a wrong sign: what was expected is no better known
_LEAST_GAIN = 0.1  # less is replaced
_TURNED = 0.1  # a sensor that is turned keeps its gain, but for as much
_BEYOND = 1.5  # times the greatest reading before: nothing healthy
_EVENLY = 0.8  # of the readings are repeated equally often
_REPEATED = 3  # samples and more are no chance


def _linear(fitter: Fitter, cls: type[Fault], shape: Shape) -> Iterator[Fit]:
    if not (shape.column or shape.beside) and cls.kind not in fitter.given:
        return
    if shape.beside:
        for axis in fitter.felt:
            yield from _leaking(fitter, cls, shape, axis)
    elif grows(cls):
        yield from _growing(fitter, cls, shape)
    else:
        column = shape.column or f"own {cls.kind}"
        (size,) = fitter.weights(column)
        found = {shape.parameter: shape.healthy + float(size)}
        errors = partial(_errors, fitter, shape.parameter, column)
        yield fitter.shaped(cls.kind, shape.family, (column,), found, errors)


def _growing(fitter: Fitter, cls: type[Fault], shape: Shape) -> Iterator[Fit]:
    """Give what grows from its onset on: from wherever it crosses zero, and from where the fault is sure.

    An earlier onset may not show.
    """
    suspect = fitter.suspect
    sure_s = float(suspect.time_s[suspect.sure])
    late, column = ("1", shape.column) if shape.column else (f"late {cls.kind}", f"own {cls.kind}")
    for names in ((late, column), (column,)):
        weights = fitter.weights(*names)
        slope = float(weights[-1])
        began_s = -float(weights[0]) / slope if len(names) == 2 and slope else 0.0
        if suspect.earliest_s <= sure_s + began_s <= sure_s + _SOON_S:
            found = {shape.parameter: shape.healthy + slope, "onset_s": sure_s + began_s}
            errors = partial(_growing_errors, fitter, shape.parameter, names, slope, began_s)
            yield fitter.shaped(cls.kind, shape.family, names, found, errors)


def _growing_errors(fitter: Fitter, name: str, names: tuple[str, ...], slope: float, began_s: float) -> Parameters:
    errors = {name: float(fitter.deviations(*names)[-1]), "onset_s": float("nan")}
    if len(names) == 2 and slope:
        by = np.array([1.0, began_s]) / slope
        errors["onset_s"] = float(np.sqrt(max(float(by @ fitter.columns.covariance(names) @ by), 0.0)))
    return errors


def _leaking(fitter: Fitter, cls: type[Fault], shape: Shape, axis: str) -> Iterator[Fit]:
    """Give the fit of a sensor that feels acceleration; none while the accelerometer tells no more than a bias does."""
    of_axis = f"of {axis}"
    if fitter.plain(of_axis).deviance <= fitter.plain("1").deviance - WORTH:
        found = {shape.parameter: float(fitter.weights(of_axis)[0])}
        errors = partial(_errors, fitter, shape.parameter, of_axis)
        yield fitter.shaped(cls.kind, shape.family, (of_axis,), found, errors, partner=axis)


def _tone(fitter: Fitter, cls: type[Fault], shape: Shape) -> Iterator[Fit]:
    """Give a sine that is added, for ever or now and then, and one in place of the signal; its frequency was fitted."""
    for family, names in ((shape.family, ("sin", "cos")), ("replacing", ("sin", "cos", "x"))):
        weights = fitter.weights(*names)
        if len(names) == 2 or (abs(weights[2] + 1.0) <= _REPLACED and not fitter.is_driven):
            found = {shape.parameter: float(np.hypot(*weights[:2])), "frequency_hz": fitter.frequency_hz}
            errors = partial(_errors, fitter, shape.parameter, "sin", "cos")
            yield fitter.shaped(cls.kind, family, names, found, errors, more=1)
    band = fitter.band
    yield _noisy(cls, shape, band, float(np.sqrt(2.0 * band.variance)), 3, frequency_hz=fitter.frequency_hz)


def _gain(fitter: Fitter, cls: type[Fault], shape: Shape) -> Iterator[Fit]:
    """Give a wrong gain, of the signal or of all that is read, noise too; near -1 it is a wrong sign."""
    (more,) = fitter.weights("x")
    factor = fitter.gain(float(more))
    is_flipped = abs(factor + 1.0) < _FLIPPED
    found = {} if is_flipped else {shape.parameter: factor}
    errors = dict if is_flipped else partial(_errors, fitter, shape.parameter, "x")
    plain = fitter.shaped(_of("sign") if is_flipped else cls.kind, shape.family, ("x",), found, errors)
    yield plain
    if abs(factor) > _LEAST_GAIN and not fitter.is_driven:
        yield replace(plain, left=fitter.suspect.rescaled(factor))


def _sign(fitter: Fitter, cls: type[Fault], shape: Shape) -> Iterator[Fit]:
    turned = 2.0 if fitter.is_driven else -2.0  # of what is read, of what should be
    fit = fitter.fixed(cls.kind, shape.family, turned * fitter.shapes["x"], {}, 0)
    yield replace(fit, left=fit.left.denser(float(fitter.volumes(np.array([turned]))[0]))) if fitter.is_driven else fit


def _fixed(fitter: Fitter, cls: type[Fault], shape: Shape) -> Iterator[Fit]:
    yield fitter.fixed(cls.kind, shape.family, fitter.added(cls, [{}])[0], {}, 0)


def _searched(fitter: Fitter, cls: type[Fault], shape: Shape) -> Iterator[Fit]:
    yield from ParameterSearch(fitter, cls, shape).fits()


def _constant(fitter: Fitter, cls: type[Fault], shape: Shape) -> Iterator[Fit]:
    suspect = fitter.suspect
    judged = suspect.measured[suspect.judged]
    value = float(np.nanmedian(judged)) if fitter.is_constant else 0.0
    if fitter.is_constant and shape.how == _how_constant(suspect, value):
        changes = (value - fitter.virtual) * fitter.on
        error = partial(_scaled, "value", 1.0, float(np.nanstd(judged)) / np.sqrt(len(judged)))
        yield fitter.fixed(cls.kind, shape.family, changes, {"value": value}, 1, error)


def _held(fitter: Fitter, cls: type[Fault], shape: Shape) -> Iterator[Fit]:
    """Give the fit of readings that are repeated as they are: evenly, or now and then (which is no kind, nor lasts)."""
    judged = fitter.suspect.measured[fitter.suspect.judged]
    held = np.diff(np.flatnonzero(np.concatenate([[True], np.diff(judged) != 0.0])))
    if fitter.is_constant or not fitter.is_straight or len(held) < 2:
        return
    usual = float(np.median(held))
    if usual >= 2.0 and np.mean(np.abs(held - usual) <= 1.0) > _EVENLY:
        whole = held[1:]  # the first had begun before
        found = {shape.parameter: float(np.mean(whole)) * fitter.period_s}
        error = partial(_scaled, shape.parameter, fitter.period_s, 0.5 / len(whole))  # both ends are known to a row
        yield fitter.fixed(cls.kind, shape.family, fitter.stale(), found, 1, error)
    else:
        free = 2 * int(np.count_nonzero(held > _REPEATED))
        fit = fitter.fixed(UNKNOWN, UNKNOWN, fitter.stale(), {}, free)
        yield replace(fit, lasts=False)


def _rounded(fitter: Fitter, cls: type[Fault], shape: Shape) -> Iterator[Fit]:
    """Give the fit of a coarse reading: its values are whole multiples of a quantum, which the readings show."""
    quantum = quantum_of(fitter.suspect.measured[fitter.suspect.judged])
    if quantum is not None:
        yield Fit(
            kind=cls.kind,
            family=shape.family,
            left=fitter.noises([()])[0][0].left,
            parameters={shape.parameter: quantum},
            free=1,
            errors=partial(_scaled, shape.parameter, quantum, 1e-9),
        )


def _white(fitter: Fitter, cls: type[Fault], shape: Shape) -> Iterator[Fit]:
    noise = fitter.noises([()])[0][0]
    yield _noisy(cls, shape, noise, float(np.sqrt(noise.variance)), 1)


def _walk(fitter: Fitter, cls: type[Fault], shape: Shape) -> Iterator[Fit]:
    for names, (_, walk) in zip(WALKING, fitter.noises(WALKING), strict=True):
        yield _noisy(cls, shape, walk, float(np.sqrt(walk.variance / fitter.period_s)), 1 + len(names))


def _spikes(fitter: Fitter, cls: type[Fault], shape: Shape) -> Iterator[Fit]:
    spikes = spikes_of(fitter.suspect)
    if spikes is not None:
        left, found, errors = spikes
        names = (shape.parameter, "rate_hz")
        yield Fit(
            kind=cls.kind,
            family=shape.family,
            left=left,
            parameters=dict(zip(names, found, strict=True)),
            free=2,
            errors=lambda: dict(zip(names, errors, strict=True)),
        )


def _turned(fitter: Fitter, cls: type[Fault], shape: Shape) -> Iterator[Fit]:
    for name in fitter.peers:
        names = ("x", f"of {name}")
        more, other = fitter.weights(*names)
        along = fitter.gain(float(more))
        across = float(other) * (along if fitter.is_driven else 1.0)
        if along < 0.0 or abs(np.hypot(along, across) - 1.0) > _TURNED:
            continue
        found = {shape.parameter: float(np.rad2deg(np.arctan2(across, along)))}
        errors = partial(_angle_error, fitter, shape.parameter, names)
        yield fitter.shaped(cls.kind, shape.family, names, found, errors, partner=name)


def _noisy(cls: type[Fault], shape: Shape, noise: NoiseFit, size: float, free: int, **beside: float) -> Fit:
    """Return the fit of noise of a size, a root of its variance, whose logarithm it tells half as wide."""
    return Fit(
        kind=cls.kind,
        family=shape.family,
        left=noise.left,
        parameters={shape.parameter: size, **beside},
        free=free,
        errors=partial(_scaled, shape.parameter, size, 0.5 * noise.spread),
        misfit=noise.misfit,
    )


def _errors(fitter: Fitter, name: str, *shapes: str) -> Parameters:
    return {name: float(fitter.deviations(*shapes).max())}


def _angle_error(fitter: Fitter, name: str, names: tuple[str, str]) -> Parameters:
    return {name: float(np.rad2deg(fitter.deviations(*names)[1]))}


def _scaled(name: str, value: float, share: float) -> Parameters:
    return {name: value * share}


def _of(how: How) -> str:
    """Return the kind that is looked for in a way that one alone is."""
    return next(kind for kind, cls in FAULTS.items() if cls.shape is not None and cls.shape.how == how)


def _how_constant(suspect: Suspect, value: float) -> How:
    """Tell constant readings apart: the last healthy one, beyond all healthy ones, or any other."""
    constant = ~(np.abs(suspect.measured - value) > 1e-9 * max(abs(value), 1e-9))  # a missing reading, too
    since = len(constant) - int(np.argmin(constant[::-1])) if not constant.all() else 0
    habit = suspect.case.habits.get(suspect.channel)
    if habit is not None and abs(value) > _BEYOND * habit.reach:
        return "beyond"
    noise = suspect.case.monitor.whiteners
    expected = suspect.virtual[min(since, len(suspect.virtual) - 1)]
    deviation = noise[suspect.channel].deviation if suspect.channel in noise else 0.2
    return "last" if value and abs(value - expected) < 4.0 * deviation else "constant"


_FITS: Mapping[How, Callable[[Fitter, type[Fault], Shape], Iterator[Fit]]] = {
    "linear": _linear,
    "search": _searched,
    "gain": _gain,
    "sign": _sign,
    "fixed": _fixed,
    "tone": _tone,
    "white": _white,
    "walk": _walk,
    "spikes": _spikes,
    **dict.fromkeys(CONSTANT, _constant),
    "repeated": _held,
    "rounded": _rounded,
    "turned": _turned,
}


def families() -> tuple[str, ...]:
    """Return the families of the kinds that are looked for."""
    return tuple(dict.fromkeys(cls.shape.family for cls in loaded_faults().values() if cls.shape is not None))


def known(fitter: Fitter) -> Iterator[Fit]:
    """Give the fits of all kinds there are; a constant reading is only one of those that replace it.

    What readings show comes first: of fits that leave the same, the first is the best. Whether two sensors have changed
    places is asked of both (`fits`).
    """
    if not fitter.is_constant:
        fitter.weigh_all()
    shapes = [(cls, cls.shape) for cls in loaded_faults().values() if cls.shape is not None]
    for cls, shape in sorted(shapes, key=lambda each: each[1].how not in SHOWN):
        is_tried = shape.how in _FITS and shape.family not in fitter.without
        if is_tried and (not fitter.is_constant or shape.how in CONSTANT) and fitter.looks(shape.when):
            yield from _FITS[shape.how](fitter, cls, shape)


def unknown(fitter: Fitter) -> Iterator[Fit]:
    """Give fits of shapes that belong to no kind, the best of them with noise, too."""
    if fitter.is_constant and "replacing" not in fitter.without:
        return
    for names in fitter.possible:
        yield _of_no_kind(fitter.plain(*names), len(names))
    yield replace(_of_no_kind(fitter.band.left, 3), misfit=fitter.band.misfit)
    for names, noises in zip(fitter.noisy, fitter.noises(fitter.noisy), strict=True):
        for noise in noises:
            yield replace(_of_no_kind(noise.left, len(names) + 1), misfit=noise.misfit)


def _of_no_kind(left: Left, free: int) -> Fit:
    return Fit(kind=UNKNOWN, family=UNKNOWN, left=left, parameters={}, free=free)
