"""Searches for the smallest fault that is detected: ``[[smallest]]`` tables, and their bisection on a flight.

A table is one of faults with two severities, the mildest and the severest to search between, and perhaps `within_s`.
Between them it is bisected in ratios, by what every severity makes of the same healthy record, so 10 trials tell a
severity to 5 %. That a severer fault is detected wherever a milder one is, isn't checked: where it doesn't hold, one of
the places is found at which detection begins.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from gtmbench.checks import naming, number, shown, table_of
from gtmbench.detectors.protocol import Watch
from gtmbench.detectors.tried_faults import TIE_S, WatchedTrials, trials_on
from gtmbench.errors import InputError
from gtmbench.faults.fault import Fault
from gtmbench.faults.registry import find_fault
from gtmbench.files.plain import Row
from gtmbench.study.fault_tables import FaultSpec, Severity, build, fault_specs, resolve
from gtmbench.study.flights import BROKEN, Flown
from gtmbench.values.record import Record

_RATIO = 1.05  # to which a severity is found
_OWN_KEYS = ("within_s",)


@dataclass(frozen=True, kw_only=True)
class SeveritySearch:
    """A kind of fault of a channel, from an onset on."""

    # mildest, severest: they differ in one severity
    mildest: FaultSpec
    severest: FaultSpec
    parameter: str  # which
    within_s: float | None = None  # how soon an alarm counts; None: until the record ends

    @property
    def bounds(self) -> tuple[Severity, Severity]:
        """The mildest and the severest."""
        return self.mildest.severities[self.parameter], self.severest.severities[self.parameter]

    @property
    def text(self) -> str:
        """The search in a line."""
        mildest, severest = self.bounds
        within = "" if self.within_s is None else f", within {self.within_s:g} s"
        name = self.mildest.kind.replace("_", " ")
        return (
            f"smallest {name} of {self.mildest.channel}, {self.parameter} {mildest} to {severest}, from "
            f"{self.mildest.onset_s:g} s{within}"
        )

    @property
    def trials(self) -> int:
        """How many it takes at most."""
        mildest, severest = self.bounds
        return 2 + _halvings(mildest.value, severest.value)

    def fault(self, severity: float, reference: Record) -> Fault:
        """Return the fault of a severity, in the bounds' terms: of a share what it comes to on a flight."""
        given = {**self.mildest.severities, self.parameter: Severity(value=severity, of=self.bounds[0].of)}
        channel = self.mildest.channel
        return build(self.mildest, {name: resolve(each, reference, channel) for name, each in given.items()})


def searches_of(given: Any, flight_s: float) -> tuple[SeveritySearch, ...]:
    """Return the searches of ``[[smallest]]`` tables, on flights of at least so many seconds.

    >>> table = {"kind": "drift", "channels": ["p", "q"], "onset_s": 60.0, "slope": [0.001, 1.0]}
    >>> [search.text for search in searches_of([table], 120.0)]
    ['smallest drift of p, slope 0.001 to 1, from 60 s', 'smallest drift of q, slope 0.001 to 1, from 60 s']
    """
    if not isinstance(given, list) or not given:
        raise InputError(f"smallest is {shown(given)}; write [[smallest]] tables, such as those of [[faults]]")
    found = []
    for number_, block in enumerate(given, 1):
        where = f"smallest {number_}"
        found += _searches(where, dict(table_of(where, block)), flight_s)
    return tuple(found)


def _searches(where: str, block: dict[str, Any], flight_s: float) -> list[SeveritySearch]:
    own = {key: block.pop(key) for key in _OWN_KEYS if key in block}
    for key in ("also", "expect"):
        if key in block:
            raise InputError(f"{where}: {key} can't stand in a search; it is for one fault at a time")
    within_s = number(f"{where}: within_s", own["within_s"], 0.0, above=True) if own else None
    with naming(where):
        severities = [item.name for item in find_fault(block.get("kind")).parameters() if item.is_severity]
    lists = [name for name in severities if isinstance(block.get(name), list)]
    if len(lists) != 1 or len(block[lists[0]]) != 2:
        raise InputError(
            f"{where}: {' and '.join(lists) or 'no severity'} is a list; give one severity of {', '.join(severities)} "
            "as two, the mildest and the severest: [0.001, 10]"
        )
    specs = fault_specs(where, block, flight_s)
    found = [
        SeveritySearch(mildest=mildest, severest=severest, parameter=lists[0], within_s=within_s)
        for mildest, severest in zip(specs[::2], specs[1::2], strict=True)
    ]
    for search in found:
        mildest, severest = search.bounds
        if mildest.of != severest.of or mildest.value * severest.value <= 0.0 or mildest.value == severest.value:
            raise InputError(
                f"{where}: {search.parameter} from {mildest} to {severest} can't be halved in ratios; give two "
                "different ones of one sign, neither of them 0, and both as figures or as shares of the same"
            )
    return found


def search_row(search: SeveritySearch, flown: Flown, quiet: Watch, number: int = BROKEN) -> Row:
    """Search on a healthy record of a flight (`Flown.sensed` has its number), with the monitor that has watched it.

    What a monitor alarms of without any fault tells nothing of one: then `detected` is left open. So it is in the loop,
    where every severity would want a flight of its own.
    """
    reference = flown.truth.between(*flown.setup.severity_reference_s)
    onset_s = search.mildest.onset_s
    until_s = math.inf if search.within_s is None else onset_s + search.within_s
    row: Row = {"look_ahead_s": round(quiet.monitor.look_ahead_s, 9)}
    if flown.is_in_loop:
        return row | {"reason": "in the loop a fault changes the flight: there is none to search on"}
    if any(onset_s - TIE_S <= alarm.time_s <= until_s + TIE_S for alarm in quiet.alarms):
        return row | {"reason": "it alarms without the fault"}
    bends = flown.bends([search.fault(search.bounds[0].value, reference)])
    trials = _watched_trials(flown, quiet, number) if bends else trials_on(quiet.monitor, quiet.record)

    def is_detected(severity: float) -> bool:
        alarm_s = trials.first_alarm_s(search.fault(severity, reference))
        return alarm_s is not None and alarm_s <= until_s + TIE_S

    mildest, severest = search.bounds
    found = first_detected(is_detected, mildest.value, severest.value)
    if found is None:
        return row | {"detected": False}
    fault = search.fault(found, reference)
    return row | {"detected": True, "smallest": found, "severity": fault.severities[search.parameter]}


def _watched_trials(flown: Flown, quiet: Watch, number: int) -> WatchedTrials:
    """Return trials that watch the record anew with every fault, as a flight's estimator bends its attitude."""
    span = quiet.record.start_s, quiet.record.end_s
    return WatchedTrials(
        quiet.monitor, quiet.record, broken=lambda fault: flown.injected([fault], number).between(*span)
    )


def first_detected(is_detected: Callable[[float], bool], mildest: float, severest: float) -> float | None:
    """Return the mildest severity that is detected, to 5 %; None where not even the severest is.

    >>> bool(abs(first_detected(lambda bias: bias > 0.37, 0.01, 100.0) / 0.37 - 1.02) < 0.03)
    True
    >>> first_detected(lambda bias: True, 0.01, 100.0), first_detected(lambda bias: False, 0.01, 100.0)
    (0.01, None)
    """
    if not is_detected(severest):
        return None
    if is_detected(mildest):
        return mildest
    for _ in range(_halvings(mildest, severest)):
        between = math.copysign(math.sqrt(mildest * severest), severest)
        mildest, severest = (mildest, between) if is_detected(between) else (between, severest)
    return severest


def _halvings(mildest: float, severest: float) -> int:
    return max(math.ceil(math.log2(abs(math.log(severest / mildest)) / math.log(_RATIO))), 0)
