"""The axes that multiply a campaign's scenarios: which there are, what they may hold, which flights come of them."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from gtmbench.bench.excitation import parts_of
from gtmbench.checks import keys, naming, shown, table_of, whole
from gtmbench.errors import InputError
from gtmbench.study.scenario import Setup, flown_by, setting, with_chain

Axes = Mapping[str, Sequence[Any]]
_RANGE = re.compile(r"\s*(\d{1,10})\s*:\s*(\d{1,10})\s*")


def axes_of(section: str, given: Any) -> dict[str, Sequence[Any]]:
    """Return the axes of a table, by name, every value checked.

    >>> axes_of("axes", {"turbulence": [False, True], "seed": "1:3"})
    {'turbulence': (False, True), 'seed': range(1, 4)}
    """
    table = keys(table_of(section, given), AXES, section=section)
    return {name: AXES[name](f"{section}.{name}", value) for name, value in table.items()}


def _listed(key: str, given: Any, check: Callable[[Any], Any]) -> tuple[Any, ...]:
    values = given if isinstance(given, list) else [given]
    if not values:
        raise InputError(f"{key} is an empty list: nothing would be flown; give a value, or leave it out")
    with naming(key):
        checked = tuple(check(value) for value in values)
    twice = [value for i, value in enumerate(checked) if value in checked[:i]]
    if twice:
        raise InputError(f"{key} holds {shown(twice[0])} twice; what is flown twice is the same flight")
    return checked


def _settings(name: str) -> Callable[[str, Any], Sequence[Any]]:
    return lambda key, given: _listed(key, given, lambda value: setting(name, value))


def _flags(key: str, given: Any) -> Sequence[bool]:
    def check(value: Any) -> bool:
        if isinstance(value, bool):
            return value
        raise InputError(f"it holds {shown(value)}; it must be true or false, or both: [false, true]")

    return _listed(key, given, check)


def _seeds(least: int, most: int) -> Callable[[str, Any], Sequence[int]]:
    """Return a check of seeds: one, a list, or the first and the last: ``"1:20"``."""

    def check(key: str, given: Any) -> Sequence[int]:
        if not isinstance(given, str):
            return _listed(key, given, lambda value: whole("a seed", value, least))
        match = _RANGE.fullmatch(given)
        seeds = range(int(match[1]), int(match[2]) + 1) if match else range(0)
        if not seeds or not least <= seeds[0] <= seeds[-1] < 2**31 or len(seeds) > most:
            raise InputError(
                f"{key} is {shown(given)}: no seed; give whole numbers from {least} on, or the first and the last of "
                f'at most {most}, such as "1:20"'
            )
        return seeds

    return check


# what a campaign may multiply its scenarios by, and how the values are checked
AXES: dict[str, Callable[[str, Any], Sequence[Any]]] = {
    "aircraft": _settings("aircraft"),
    "excitation": _settings("excitation"),
    "turbulence": _flags,
    "closed_loop": _flags,
    "altitude_ft": _settings("altitude_ft"),
    "tas_kt": _settings("tas_kt"),
    "attitude": _settings("attitude"),
    "seed": _seeds(0, 10_000_000),
    "noise_seed": _seeds(1, 10_000),
}
_OF_A_FLIGHT = tuple(name for name in AXES if name != "noise_seed")  # a flight is measured many times


def count(axes: Axes) -> int:
    """Return how many flights axes come to."""
    return math.prod(len(axes[name]) for name in _OF_A_FLIGHT if name in axes)


def noise_seeds(axes: Axes) -> Sequence[int]:
    """Return the noise seeds, by which every flight is measured."""
    return axes.get("noise_seed", (1,))


def flights(setup: Setup, axes: Axes) -> Iterator[Setup]:
    """Give a setup with every combination of the axes' values."""
    named = [name for name in axes if name in _OF_A_FLIGHT]
    for values in itertools.product(*(axes[name] for name in named)):
        changed = dict(zip(named, values, strict=True))
        turbulent, closed = changed.pop("turbulence", None), changed.pop("closed_loop", None)
        flown = with_chain(_in_loop(replace(setup, **changed), setup, closed))
        yield flown if turbulent is None else replace(flown, excitation=_in_air(flown.excitation, turbulent))


def _in_loop(setup: Setup, stated: Setup, closed: bool | None) -> Setup:
    """Return a flight with its loop closed, open, or as the scenario states it; gains are the aircraft's that flies."""
    if closed is False or (closed is None and stated.autopilot is None):
        return replace(setup, autopilot=None, controller=None if closed is False else setup.controller)
    if stated.controller is not None:
        return setup
    own = stated.autopilot if setup.aircraft == stated.aircraft else None
    return flown_by(setup, own, setup.noise is None)


def _in_air(excitation: str, turbulent: bool) -> str:
    """Return an excitation in turbulent air, or in calm.

    >>> _in_air("doublets", True), _in_air("multisine+turbulence", False)
    ('doublets+turbulence', 'multisine')
    """
    moved = [part for part in parts_of(excitation) if part != "turbulence"]
    parts = moved + ["turbulence"] * turbulent
    if not parts:
        raise InputError("excitation 'turbulence' with turbulence = false: nothing would move; give another excitation")
    return "+".join(parts)


def fact_of_axis(values: Sequence[Any]) -> Any:
    """Say the values of an axis, as plain ones."""
    return f"{values[0]}:{values[-1]}" if isinstance(values, range) else list(values)
