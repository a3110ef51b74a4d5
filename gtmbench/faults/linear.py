"""A kind's class tried on a signal: whether its shape is what it says, and what it does grows from the onset on."""

from __future__ import annotations

from typing import Any

import numpy as np

from gtmbench.errors import InputError
from gtmbench.faults.fault import Fault
from gtmbench.faults.shape import Shape
from gtmbench.values.record import FloatArray

_TS_S = 0.01
_ROWS = 200  # of a signal that classes are tried on
_ALIKE = 1e-6  # of what is added

_grows: dict[type[Fault], bool] = {}  # a diagnosis asks thousands of times


def size_one(cls: type[Fault]) -> dict[str, float]:
    """Return the parameter of a linear kind at size one."""
    assert cls.shape is not None
    return {cls.shape.parameter: cls.shape.healthy + 1.0}


def tried(cls: type[Fault], parameters: dict[str, float], late_s: float = 0.0) -> FloatArray:
    """Return what a fault that has been there for a while adds to a signal that swings; shape (200,)."""
    figures: dict[str, Any] = parameters
    lacking = [each.name for each in cls.parameters() if each.is_required and each.name not in parameters]
    if lacking:
        raise InputError(f"{cls.kind}: its shape leaves {lacking[0]} open; give that a default")
    fault = cls(channel="p", onset_s=0.0, **figures)
    elapsed_s: FloatArray = _TS_S * np.arange(_ROWS, dtype=np.float64)
    signal = 5.0 * np.sin(4.0 * elapsed_s) + 2.0
    reads, _ = fault.distort(signal[:, np.newaxis], elapsed_s + late_s, _TS_S, fault.begin(signal[:1]))
    reads = np.asarray(reads, dtype=np.float64)
    if reads.shape != signal.shape or not np.isfinite(reads).all():
        given = ", ".join(f"{name} = {value:g}" for name, value in parameters.items())
        raise InputError(
            f"{cls.kind}: with {given} it reads no number of a healthy signal; correct its distort or shape"
        )
    return np.asarray(reads - signal)


def grows(cls: type[Fault]) -> bool:
    """Tell whether what a kind does changes with the time since its onset.

    >>> from gtmbench.faults.kinds.additive import Bias, Drift
    >>> grows(Bias), grows(Drift)
    (False, True)
    """
    return _grows[cls] if cls in _grows else _grows.setdefault(cls, _is_growing(cls))


def _is_growing(cls: type[Fault]) -> bool:
    shape = cls.shape
    if shape is None or shape.beside or shape.how not in ("linear", "search"):
        return False
    usual = size_one(cls) if shape.how == "linear" else _amid(shape)
    return _differ(tried(cls, usual), tried(cls, usual, late_s=1.0))


def _amid(shape: Shape) -> dict[str, float]:
    """Return parameters amid those that are searched."""
    sizes = {shape.size: 1.0} if shape.size else {}
    return {shape.parameter: float(np.sqrt(shape.low * shape.high)), **sizes}


def check_shape(cls: type[Fault]) -> None:
    """Refuse a class whose shape isn't what it says: of no number, not linear, or one that a healthy sensor has."""
    shape = cls.shape
    if shape is None:
        return
    names = {each.name for each in cls.parameters()}
    if shape.how not in ("linear", "search", "fixed"):
        raise InputError(f"{cls.kind}: its shape's how is '{shape.how}'; it must be 'linear', 'search' or 'fixed'")
    for name in (shape.parameter, shape.size):
        if (name and name not in names) or (shape.how != "fixed" and not shape.parameter):
            raise InputError(f"{cls.kind}: its shape's parameter is '{name}'; it has {sorted(names) or 'none'}")
    if shape.how == "linear":
        one, two = (tried(cls, {shape.parameter: shape.healthy + size}) for size in (1.0, 2.0))
        if _differ(tried(cls, {shape.parameter: shape.healthy}), np.zeros_like(one)):
            raise InputError(
                f"{cls.kind}: with {shape.parameter} = {shape.healthy:g} it changes something; say what is healthy"
            )
        if _differ(2.0 * one, two) or not one.any():
            raise InputError(f"{cls.kind} isn't linear in {shape.parameter}; give it a shape that is a search")
    else:
        tried(cls, _amid(shape) if shape.how == "search" else {})


def _differ(one: FloatArray, other: FloatArray) -> bool:
    return bool(np.abs(one - other).max() > _ALIKE * max(np.abs(one).max(), np.abs(other).max(), _ALIKE))
