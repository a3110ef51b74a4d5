"""A check as plain data: what ``gtmbench check --json`` prints."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from gtmbench.check.baseline import Reference
from gtmbench.check.compare import Compared, Number, Pair
from gtmbench.check.run import Check
from gtmbench.report.tables.results import versions


def check_results(found: Check) -> dict[str, Any]:
    """Return a check as one JSON-ready object: every figure, and those that are worse or better beside it."""
    return {
        **_origin(found.reference),
        "passed": not found.regressions,
        "regressions": [_compared(one) for one in found.regressions],
        "better": [_compared(one) for one in found.better],
        "figures": [_compared(one) for one in found.compared],
        "versions": versions(),
    }


def update_results(reference: Reference, pairs: Iterable[Pair]) -> dict[str, Any]:
    """Return what a new baseline changes as one JSON-ready object; None: there is no such figure."""
    changed = [_pair(pair) for pair in pairs if repr(pair.was) != repr(pair.now)]
    return {**_origin(reference), "updated": True, "changes": changed, "versions": versions()}


def _origin(reference: Reference) -> dict[str, Any]:
    return {
        "baseline": str(reference.path),
        "scenarios": [scenario.name for scenario in reference.scenarios],
        "seed": reference.seed,
        "detector": reference.detector,
        "monitor": reference.detector,  # its name of before
    }


def _compared(one: Compared) -> dict[str, Any]:
    allowed = {"allowed_from": _finite(one.low), "allowed_to": _finite(one.high)}
    return {**_pair(one), **allowed, "remark": one.remark}


def _pair(pair: Pair) -> dict[str, Any]:
    return {
        "group": pair.group,
        "figure": pair.figure,
        "at": pair.at,
        "was": _finite(pair.was),
        "is": _finite(pair.now),
        "unit": pair.unit,
    }


def _finite(value: Number | None) -> Number | None:
    """Return a number as JSON has it: None where it isn't finite."""
    return None if value is None or not math.isfinite(value) else value
