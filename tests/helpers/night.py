"""Which cases of a family every run of the tests tries, and which the night's alone."""

from __future__ import annotations

import random
from collections.abc import Iterable
from typing import Any

import pytest


def by_day(cases: Iterable[Any], count: int = 1, *, seed: int | None = None) -> list[Any]:
    """Return a family's cases, of which every run tries the first, or a seeded draw; the others run by night."""
    every = list(cases)
    places = range(len(every))
    day = set(places[:count] if seed is None else random.Random(seed).sample(places, min(count, len(every))))
    return [each if place in day else _by_night(each) for place, each in enumerate(every)]


def _by_night(case: Any) -> Any:
    if isinstance(case, type(pytest.param())):
        return pytest.param(*case.values, id=case.id, marks=[*case.marks, pytest.mark.nightly])
    return pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.nightly)
