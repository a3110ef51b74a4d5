"""The kinds of faults: built in, registered by a user's module, or announced by a package; each tried on a signal.

And a fault in a line of text: ``bias:r:size=2``, its kind, its channel and its parameters.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields
from importlib import import_module
from pkgutil import iter_modules
from typing import Any, TypeVar

import numpy as np

from gtmbench.checks import listed, meant, number, shown
from gtmbench.errors import InputError
from gtmbench.faults import kinds
from gtmbench.faults.fault import Fault
from gtmbench.faults.parameter import Intermittent, Parameter
from gtmbench.faults.shape import PassesFor, Shape, WholeLog
from gtmbench.imports import FAULTS as GROUP
from gtmbench.imports import installed, load_installed, load_module
from gtmbench.values.channels import breakable_list
from gtmbench.values.record import FloatArray

_KIND = re.compile("[a-z][a-z0-9_]{0,39}")
_HOW = "@dataclass(frozen=True, kw_only=True)"

_Class = TypeVar("_Class", bound=type[Fault])


def _built_in() -> Iterator[type[Fault]]:
    """Give the classes of the files of `gtmbench/faults/kinds` that have a kind."""
    for file in iter_modules(kinds.__path__, f"{kinds.__name__}."):
        for cls in vars(import_module(file.name)).values():
            if isinstance(cls, type) and issubclass(cls, Fault) and "kind" in vars(cls) and cls.__module__ == file.name:
                yield cls


FAULTS: dict[str, type[Fault]] = {cls.kind: cls for cls in _built_in()}
_registered: dict[str, type[Fault]] = {}


def register_fault(cls: _Class) -> _Class:
    """Register a kind of fault by its name, for use in scenarios; a decorator.

    A scenario file names it once ``gtmbench run --import PACKAGE`` has imported the class's module. In Python, faults
    of any class work as they are, registered or not.

    Raises
    ------
    InputError
        If it isn't a frozen dataclass with a `kind` and a `distort` or `distort_sample`, or the kind is taken by
        another class.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> import gtmbench as gb
    >>> @gb.register_fault
    ... @dataclass(frozen=True, kw_only=True)
    ... class Step(gb.Fault):
    ...     kind = "step"
    ...     size: float = gb.severity(per_second=False)
    ...
    ...     def distort(self, readings, elapsed_s, sample_period_s, carried):
    ...         return readings[:, 0] + self.size, None
    >>> from gtmbench.faults.registry import find_fault
    >>> find_fault("step") is Step
    True
    """
    _checked(cls)
    there = loaded_faults().get(cls.kind)
    # the same module's class of the same name is this one, defined again: a notebook's cell that has been run twice
    if there is not None and there is not cls and _place(there) != _place(cls):
        raise InputError(f"kind '{cls.kind}' of {_place(cls)} is taken by {_place(there)}; give it another name")
    if cls.kind not in FAULTS:
        check_shape(cls)
        _registered[cls.kind] = cls
    return cls


def loaded_faults() -> dict[str, type[Fault]]:
    """Return the kinds whose classes are there, by name: built in or registered."""
    return {**FAULTS, **_registered}


def shape_of(kind: str | None) -> Shape | None:
    """Return how a kind shows; None of what is no kind, or has none."""
    cls = _class_of(kind)
    return None if cls is None else cls.shape


def whole_log_of(kind: str | None) -> WholeLog | None:
    """Return how a kind shows in a whole log; None of what is no kind, or shows nothing there."""
    cls = _class_of(kind)
    return None if cls is None else cls.whole_log


def _class_of(kind: str | None) -> type[Fault] | None:
    return FAULTS.get(kind or "") or _registered.get(kind or "")


def how_of(kind: str | None) -> str:
    """Return how a kind is looked for; "" of one that isn't.

    >>> how_of("bias"), how_of("unknown")
    ('linear', '')
    """
    shape = shape_of(kind)
    return "" if shape is None else shape.how


def passes_for(kind: str | None, healthy: PassesFor) -> bool:
    """Tell whether something healthy looks like a kind.

    >>> passes_for("lag", "motion"), passes_for("jam", "motion")
    (True, False)
    """
    shape = shape_of(kind)
    return shape is not None and healthy in shape.passes_for


def fault_kinds() -> tuple[str, ...]:
    """Return the names of all kinds: built in, registered, and announced by installed packages (not imported).

    >>> fault_kinds()[:6]
    ('bias', 'drift', 'thermal_bias', 'oscillation', 'random_walk', 'noise')
    """
    return tuple(dict.fromkeys([*loaded_faults(), *installed(GROUP)]))


def find_fault(kind: Any) -> type[Fault]:
    """Return the class of a kind; that of an installed package is imported now."""
    loaded = loaded_faults()
    if isinstance(kind, str) and kind in loaded:
        return loaded[kind]
    if not isinstance(kind, str) or kind not in installed(GROUP):
        known = f"{', '.join(fault_kinds())} (--import a file or package that registers others)"
        raise InputError(f"kind is {shown(kind)}; there are {known}{meant(kind, fault_kinds())}")
    cls = _checked(load_installed(GROUP, kind))
    if cls.kind != kind:
        raise InputError(f"{_place(cls)} is announced as kind '{kind}', but calls itself '{cls.kind}'")
    return register_fault(cls)


def import_package(source: str) -> tuple[str, ...]:
    """Import a module, ``FILE.py`` or ``package.module``, for the kinds of faults that it registers; return these."""
    name = load_module(source).__name__
    return tuple(kind for kind, cls in _registered.items() if f"{cls.__module__}.".startswith(f"{name}."))


def _checked(cls: object) -> type[Fault]:
    """Return a class of the user's if it is a kind of fault, or say what it lacks."""
    if not isinstance(cls, type) or not issubclass(cls, Fault):
        raise InputError(f"{shown(cls)} is no kind of fault; derive a class from gb.Fault")
    kind, place = getattr(cls, "kind", None), _place(cls)
    if not isinstance(kind, str) or not _KIND.fullmatch(kind):
        raise InputError(f"{place}: kind is {shown(kind)}; give a name of small letters, digits and _, as 'bias_step'")
    if cls.distort is Fault.distort and cls.distort_sample is Fault.distort_sample:
        raise InputError(f"{place} has no distort; define how it changes the samples")
    if "__dataclass_params__" not in vars(cls) or not vars(cls)["__dataclass_params__"].frozen:
        raise InputError(f"{place} isn't a frozen dataclass; put {_HOW} above it, and @register_fault above that")
    common = Fault.__dataclass_fields__
    for each in fields(cls):
        unset = each.default is MISSING and each.default_factory is MISSING
        if unset and each.init and not each.metadata and each.name not in common:
            raise InputError(f"{place}: declare '{each.name}' by severity() or other_channel(), or give it a default")
    return cls


def _place(cls: Any) -> str:
    return f"{cls.__module__}.{cls.__qualname__}"


_TS_S = 0.01  # a sample period that classes are tried at
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


_TIMES = ("onset_s", "duration_s", "ramp_s")
_WRITTEN = "write KIND:CHANNEL:KEY=VALUE,..., such as bias:r:size=2"
_FLAGS = {"true": True, "false": False}
PREFIX = "px4_"


@dataclass(frozen=True, kw_only=True)
class Word:
    """A word of PX4's."""

    kind: str  # of ours
    parameters: Mapping[str, object] = field(default_factory=dict)  # of the kind, unless something else is given
    differs: str = ""  # where the two differ; "" where they don't


# PX4's developer guide, "System Failure Injection", says what each word means, and leaves to the simulator how it
# looks. Where a word says less than a kind, or something else, its row says so.
WORDS: Mapping[str, Word] = {
    "px4_off": Word(kind="dropout"),
    "px4_stuck": Word(kind="jam", differs="PX4 says the same value each time; which one is left to the simulator"),
    "px4_garbage": Word(
        kind="noise",
        parameters={"deviation": 500.0},
        differs="PX4 publishes random noise in place of readings; here it is normal, and added to them",
    ),
    "px4_wrong": Word(
        kind="bias", differs="PX4 says a wrong value that looks reasonable; here it is off by a size that you give"
    ),
    "px4_slow": Word(
        kind="stale",
        parameters={"hold_s": 0.1},
        differs="PX4 publishes at a lower rate; here the rate stays, and readings are repeated",
    ),
    "px4_delayed": Word(
        kind="delay", parameters={"delay_s": 0.5}, differs="PX4 says significantly late; here it is half a second"
    ),
    "px4_intermittent": Word(
        kind="dropout",
        parameters={"intermittent": Intermittent(period_s=2.0, duty=0.5, by_chance=True)},
        differs="PX4 doesn't say how often; here half of the time, for a second on average",
    ),
}


def fault(text: str, *, onset_s: float | None = None) -> Fault:
    """Return a fault that is given in a line, as ``--fault`` takes it.

    Parameters
    ----------
    text : str
        ``KIND:CHANNEL``, or a failure as PX4 calls it, such as ``px4_slow:CHANNEL``, and behind another colon the
        kind's parameters, ``duration_s`` and ``ramp_s``, between commas.
        Figures are in the channel's unit.
    onset_s : float, optional
        When it begins, where the text has no ``onset_s``.

    Raises
    ------
    InputError
        If there is no such kind or channel, a parameter is missing, unknown or can't be what it is, or no onset is
        given.

    Examples
    --------
    >>> import gtmbench as gb
    >>> gb.fault("bias:r:size=2", onset_s=60)
    Bias(channel='r', onset_s=60.0, duration_s=None, ramp_s=0.0, intermittent=None, size=2.0)
    >>> gb.fault("drift:p:slope=0.1,duration_s=5,onset_s=20").duration_s
    5.0
    >>> gb.fault("jam:elevator", onset_s=20).channel
    'elevator'
    >>> gb.fault("px4_slow:q", onset_s=20).hold_s
    0.1
    """
    kind, _, rest = text.partition(":")
    channel, _, settings = rest.partition(":")
    where = f"fault {shown(text)}"
    if not channel.strip():
        raise InputError(f"{where} names no channel; {_WRITTEN}")
    try:
        word = WORDS.get(kind.strip())
        if word is None and kind.strip().startswith(PREFIX):
            raise InputError(f"PX4 has no such failure; there are {listed(WORDS)}{meant(kind.strip(), WORDS)}")
        cls = find_fault(kind.strip() if word is None else word.kind)
        (name,) = breakable_list("its channel", [channel.strip()])
        given = _given(cls, settings, {} if word is None else word.parameters)
        given.setdefault("onset_s", onset_s)
        if given["onset_s"] is None:
            raise InputError("nothing says when it begins; add --onset SECONDS, or onset_s=SECONDS behind the channel")
        given["onset_s"] = number("onset_s", given["onset_s"], 0.0)
        return cls(channel=name, **given)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def _given(cls: type[Fault], text: str, usual: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters and times that a text gives, and others as usual."""
    parameters = {item.name: item for item in cls.parameters()}
    given: dict[str, Any] = dict(usual)
    for part in filter(None, map(str.strip, text.split(","))):
        key, equals, value = map(str.strip, part.partition("="))
        known = [*parameters, *_TIMES]
        if key not in known or not equals:
            raise InputError(f"{shown(part)} isn't KEY=VALUE; a {cls.kind} has {listed(known)}{meant(key, known)}")
        given[key] = _value(key, value, parameters.get(key))
    lacking = [item.name for item in parameters.values() if item.is_required and item.name not in given]
    if lacking:
        raise InputError(f"a {cls.kind} needs {listed(lacking)}: {cls.kind}:CHANNEL:{lacking[0]}=...")
    return given


def _value(key: str, text: str, item: Parameter | None) -> Any:
    """Return what a parameter, or a time, is given as."""
    kind = float if item is None else item.value_type
    if kind is str:
        return text
    try:
        return _FLAGS[text] if kind is bool else kind(text)
    except (ValueError, KeyError):
        legal = {float: "a number", int: "a whole number", bool: "true or false"}[kind]
        raise InputError(f"{key} is {shown(text)}; it must be {legal}") from None
