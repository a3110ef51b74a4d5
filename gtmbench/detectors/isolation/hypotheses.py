"""Fault hypotheses: what a broken sensor adds to what it should have read, by families of faults.

The same for gyros and angles, or the richer side wins. Linear ones are least squares in a few shapes; others try values
of one parameter on the fault's own class (`gtmbench.faults`); noise is judged by its spectrum. A hypothesis without a
kind explains what nobody wrote one for: it names a sensor, and its kind is `unknown`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from gtmbench.detectors.isolation.fitter import UNKNOWN, WALKING, WORTH, Fit, Fitter, Parameters
from gtmbench.detectors.isolation.noise import spikes_of
from gtmbench.detectors.isolation.search import (
    Search,
    before_deadzone,
    before_saturation,
    hysteresis_step,
    rate_limited_step,
)
from gtmbench.detectors.isolation.standing import quantum_of
from gtmbench.detectors.isolation.suspect import Left, Suspect

_REPLACED = 0.1  # of the signal, may be left of it
_SOON_S = 0.1
_FLIPPED = 0.1  # a gain that near -1 is a wrong sign: what was expected is no better known
_LEAST_GAIN = 0.1  # less is replaced
_TURNED = 0.1  # a sensor that is turned keeps its gain, but for as much
_BEYOND = 1.5  # times the greatest reading before: nothing healthy
_EVENLY = 0.8  # of the readings are repeated equally often
_REPEATED = 3  # samples and more are no chance


def _additive(fitter: Fitter) -> Iterator[Fit]:
    (size,) = fitter.weights("1")
    yield fitter.shaped("bias", "additive", ("1",), {"size": float(size)}, partial(_errors, fitter, "size", "1"))
    yield from _drift(fitter)
    yield from _oscillation(fitter)
    for names, (_, walk) in zip(WALKING, fitter.noises(WALKING), strict=True):
        gain = float(np.sqrt(walk.variance / fitter.period_s))
        yield Fit(
            kind="random_walk",
            family="additive",
            left=walk.left,
            parameters={"gain": gain},
            free=1 + len(names),
            errors=partial(_scaled, "gain", gain, 0.5 * walk.spread),
            misfit=walk.misfit,
        )


def _drift(fitter: Fitter) -> Iterator[Fit]:
    """Give the ramps: from wherever it crosses zero, and from where the fault is sure (an offset may not show)."""
    suspect = fitter.suspect
    sure_s = float(suspect.time_s[suspect.sure])
    for names in (("1", "t"), ("t",)):
        weights = fitter.weights(*names)
        slope = float(weights[-1])
        began_s = -float(weights[0]) / slope if len(names) == 2 and slope else 0.0
        if suspect.earliest_s <= sure_s + began_s <= sure_s + _SOON_S:
            found = {"slope": slope, "onset_s": sure_s + began_s}
            errors = partial(_ramp_errors, fitter, names, slope, began_s)
            yield fitter.shaped("drift", "additive", names, found, errors)


def _ramp_errors(fitter: Fitter, names: tuple[str, ...], slope: float, began_s: float) -> Parameters:
    errors = {"slope": float(fitter.deviations(*names)[-1]), "onset_s": float("nan")}
    if len(names) == 2 and slope:
        by = np.array([1.0, began_s]) / slope
        errors["onset_s"] = float(np.sqrt(max(float(by @ fitter.columns.covariance(names) @ by), 0.0)))
    return errors


def _oscillation(fitter: Fitter) -> Iterator[Fit]:
    """Give a sine that is added, for ever or now and then, and one in place of the signal; its frequency was fitted."""
    for family, names in (("additive", ("sin", "cos")), ("replacing", ("sin", "cos", "x"))):
        weights = fitter.weights(*names)
        if len(names) == 2 or (abs(weights[2] + 1.0) <= _REPLACED and not fitter.is_driven):
            found = {"amplitude": float(np.hypot(*weights[:2])), "frequency_hz": fitter.frequency_hz}
            errors = partial(_errors, fitter, "amplitude", "sin", "cos")
            yield fitter.shaped("oscillation", family, names, found, errors, more=1)
    tone = {"amplitude": float(np.sqrt(2.0 * fitter.band.variance)), "frequency_hz": fitter.frequency_hz}
    spread = partial(_scaled, "amplitude", tone["amplitude"], 0.5 * fitter.band.spread)
    yield Fit(
        kind="oscillation",
        family="additive",
        left=fitter.band.left,
        parameters=tone,
        free=3,
        errors=spread,
        misfit=fitter.band.misfit,
    )


def _multiplicative(fitter: Fitter) -> Iterator[Fit]:
    """Give a wrong gain, of the signal or of all that is read, noise too, and a wrong sign."""
    (more,) = fitter.weights("x")
    factor = fitter.gain(float(more))
    is_flipped = abs(factor + 1.0) < _FLIPPED
    plain = fitter.shaped(
        "sign_flip" if is_flipped else "scale_factor",
        "multiplicative",
        ("x",),
        {} if is_flipped else {"factor": factor},
        dict if is_flipped else partial(_errors, fitter, "factor", "x"),
    )
    yield plain
    if abs(factor) > _LEAST_GAIN and not fitter.is_driven:
        yield replace(plain, left=fitter.suspect.rescaled(factor))
    turned = 2.0 if fitter.is_driven else -2.0  # of what is read, of what should be
    yield fitter.fixed("sign_flip", "multiplicative", turned * fitter.shapes["x"], {}, 0)


def _timing(fitter: Fitter) -> Iterator[Fit]:
    if not fitter.is_late():
        return
    yield from Search(kind="lag", family="timing", name="lag_s", low=0.005, high=1.0).fits(fitter)
    yield from Search(kind="delay", family="timing", name="delay_s", low=0.01, high=1.0).fits(fitter)


def _replacing(fitter: Fitter) -> Iterator[Fit]:
    suspect = fitter.suspect
    judged = suspect.measured[suspect.judged]
    if fitter.is_constant:
        value = float(np.nanmedian(judged))
        changes = (value - fitter.virtual) * fitter.on
        error = partial(_scaled, "value", 1.0, float(np.nanstd(judged)) / np.sqrt(len(judged)))
        yield fitter.fixed(_constant_kind(suspect, value), "replacing", changes, {"value": value}, 1, error)
    elif fitter.is_straight:
        yield from _held(fitter)


def _held(fitter: Fitter) -> Iterator[Fit]:
    """Give the fit of readings that are repeated as they are: evenly, or now and then (which is no kind, nor lasts)."""
    judged = fitter.suspect.measured[fitter.suspect.judged]
    held = np.diff(np.flatnonzero(np.concatenate([[True], np.diff(judged) != 0.0])))
    if len(held) < 2:
        return
    usual = float(np.median(held))
    if usual >= 2.0 and np.mean(np.abs(held - usual) <= 1.0) > _EVENLY:
        whole = held[1:]  # the first had begun before
        hold_s = float(np.mean(whole)) * fitter.period_s
        error = partial(_scaled, "hold_s", fitter.period_s, 0.5 / len(whole))  # both ends are known to a row
        yield fitter.fixed("stale", "replacing", fitter.stale(), {"hold_s": hold_s}, 1, error)
    else:
        free = 2 * int(np.count_nonzero(held > _REPEATED))
        fit = fitter.fixed(UNKNOWN, UNKNOWN, fitter.stale(), {}, free)
        yield replace(fit, lasts=False)


def _clipping(fitter: Fitter) -> Iterator[Fit]:
    if not fitter.is_traced:  # what clips or holds readings leaves traces in them
        return
    virtual = fitter.virtual[fitter.suspect.sure :]
    reach = float(np.max(np.abs(virtual), initial=0.0))
    saturation = Search(
        kind="saturation",
        family="clipping",
        name="limit",
        low=reach / 100.0,
        high=reach,
        shown=fitter.limit,
        undone=before_saturation,
    )
    if not fitter.is_straight:
        yield from saturation.fits(fitter)
        return
    slew = 2.0 * float(np.max(np.abs(np.diff(virtual)), initial=0.0)) / fitter.period_s
    step = fitter.straight_step / fitter.period_s
    for search in (
        Search(
            kind="deadzone", family="clipping", name="half_width", low=reach / 100.0, high=reach, undone=before_deadzone
        ),
        saturation,
        Search(
            kind="rate_saturation",
            family="clipping",
            name="rate_limit",
            low=0.7 * step or slew / 100.0,
            high=1.4 * step or slew,
            shown=step,
            step=rate_limited_step,
        ),
        Search(
            kind="hysteresis",
            family="clipping",
            name="width",
            low=reach / 50.0,
            high=2.0 * reach,
            step=hysteresis_step,
        ),
    ):
        yield from search.fits(fitter)
    yield from _quantised(fitter)


def _variance(fitter: Fitter) -> Iterator[Fit]:
    noise = fitter.noises([()])[0][0]
    deviation = float(np.sqrt(noise.variance))
    yield Fit(
        kind="noise",
        family="variance",
        left=noise.left,
        parameters={"deviation": deviation},
        free=1,
        errors=partial(_scaled, "deviation", deviation, 0.5 * noise.spread),
        misfit=noise.misfit,
    )
    spikes = spikes_of(fitter.suspect)
    if spikes is not None:
        yield Fit(
            kind="spikes",
            family="variance",
            left=spikes.left,
            parameters={"size": spikes.size, "rate_hz": spikes.rate_hz},
            free=2,
            errors=partial(dict, size=spikes.size_error, rate_hz=spikes.rate_hz / float(np.sqrt(spikes.count))),
        )


def _crossing(fitter: Fitter) -> Iterator[Fit]:
    for name in fitter.peers:
        names = ("x", f"of {name}")
        more, other = fitter.weights(*names)
        along = fitter.gain(float(more))
        across = float(other) * (along if fitter.is_driven else 1.0)
        if along < 0.0 or abs(np.hypot(along, across) - 1.0) > _TURNED:
            continue
        found = {"angle_deg": float(np.rad2deg(np.arctan2(across, along)))}
        errors = partial(_angle_error, fitter, names)
        yield fitter.shaped("misalignment", "cross-axis", names, found, errors, partner=name)
    for name in fitter.felt:
        yield from _leaking(fitter, name)


def _leaking(fitter: Fitter, axis: str) -> Iterator[Fit]:
    """Give the fit of a sensor that feels acceleration; none while the accelerometer tells no more than a bias does."""
    of_axis = f"of {axis}"
    if fitter.plain(of_axis).deviance <= fitter.plain("1").deviance - WORTH:
        found = {"coefficient": float(fitter.weights(of_axis)[0])}
        errors = partial(_errors, fitter, "coefficient", of_axis)
        yield fitter.shaped("g_sensitivity", "cross-axis", (of_axis,), found, errors, partner=axis)


def _errors(fitter: Fitter, name: str, *shapes: str) -> Parameters:
    return {name: float(fitter.deviations(*shapes).max())}


def _angle_error(fitter: Fitter, names: tuple[str, str]) -> Parameters:
    return {"angle_deg": float(np.rad2deg(fitter.deviations(*names)[1]))}


def _scaled(name: str, value: float, share: float) -> Parameters:
    return {name: value * share}


def _quantised(fitter: Fitter) -> Iterator[Fit]:
    """Give the fit of a coarse reading: its values are whole multiples of a quantum, which the readings show."""
    suspect = fitter.suspect
    quantum = quantum_of(suspect.measured[suspect.judged])
    if quantum is None:
        return
    yield Fit(
        kind="quantisation",
        family="clipping",
        left=fitter.noises([()])[0][0].left,
        parameters={"quantum": quantum},
        free=1,
        errors=partial(_scaled, "quantum", quantum, 1e-9),
    )


def _constant_kind(suspect: Suspect, value: float) -> str:
    """Tell kinds of constant readings apart: the last healthy one, beyond all healthy ones, or any other."""
    constant = ~(np.abs(suspect.measured - value) > 1e-9 * max(abs(value), 1e-9))  # a missing reading, too
    since = len(constant) - int(np.argmin(constant[::-1])) if not constant.all() else 0
    habit = suspect.case.habits.get(suspect.channel)
    if habit is not None and abs(value) > _BEYOND * habit.reach:
        return "hardover"
    noise = suspect.case.monitor.whiteners
    expected = suspect.virtual[min(since, len(suspect.virtual) - 1)]
    deviation = noise[suspect.channel].deviation if suspect.channel in noise else 0.2
    return "jam" if value and abs(value - expected) < 4.0 * deviation else "stuck"


FAMILIES: Mapping[str, Callable[[Fitter], Iterator[Fit]]] = {
    "additive": _additive,
    "multiplicative": _multiplicative,
    "timing": _timing,
    "replacing": _replacing,
    "clipping": _clipping,
    "variance": _variance,
    "cross-axis": _crossing,
}


def known(fitter: Fitter) -> Iterator[Fit]:
    """Give the fits of all kinds there are; a constant reading is only one of those that replace it."""
    if not fitter.is_constant:
        fitter.weigh_all()
    for family, kinds in FAMILIES.items():
        if family not in fitter.without and (family == "replacing" or not fitter.is_constant):
            yield from kinds(fitter)


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
