"""Logs that aren't what they say: 24 ways in which a self-check is tried, and what makes a record so."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from gtmbench.log.self_check.causes import WiringChange, undone
from gtmbench.values.record import Record

_DEG = math.degrees(1.0)


@dataclass(frozen=True, kw_only=True)
class Mutation:
    """What is wrong with a log.

    Attributes
    ----------
    changes : tuple of Change
        What has to be undone: the cause.
    mirrored : tuple of Change
        The same motion, told otherwise: a cause that is as right; empty where there is none as simple.
    dead : str
        The channel that reads one value; "" for none.
    """

    changes: tuple[WiringChange, ...] = ()
    mirrored: tuple[WiringChange, ...] = ()
    dead: str = ""

    def mutate(self, record: Record) -> Record:
        """Return a record that has to be read so."""
        if self.dead:
            return record.replace(self.dead, np.full(len(record), 0.1))
        return mutated(record, self.changes)


def _signs(*channels: str) -> tuple[WiringChange, ...]:
    return tuple(WiringChange(kind="sign", channels=(name,)) for name in channels)


def _unit(*channels: str, size: float = _DEG) -> tuple[WiringChange, ...]:
    return (WiringChange(kind="unit", channels=channels, size=size),)


def _swap(*channels: str) -> tuple[WiringChange, ...]:
    return (WiringChange(kind="swap", channels=channels),)


def _late(size: float, *channels: str) -> tuple[WiringChange, ...]:
    return (WiringChange(kind="late", channels=channels, size=size),)


MUTATIONS: dict[str, Mutation] = {
    "none": Mutation(),
    "-p": Mutation(changes=_signs("p")),
    "-q": Mutation(changes=_signs("q")),
    "-r": Mutation(changes=_signs("r")),
    "-q -r": Mutation(changes=_signs("q", "r"), mirrored=_signs("psi", "theta")),
    "-p -r": Mutation(changes=_signs("p", "r"), mirrored=_signs("phi", "psi")),
    "-phi": Mutation(changes=_signs("phi")),
    "-theta": Mutation(changes=_signs("theta")),
    "-psi": Mutation(changes=_signs("psi")),
    "p in rad/s": Mutation(changes=_unit("p")),
    "gyros in rad/s": Mutation(changes=_unit("p", "q", "r")),
    "gyros in deg/s, said rad/s": Mutation(changes=_unit("p", "q", "r", size=1.0 / _DEG)),
    "angles in rad": Mutation(changes=_unit("phi", "theta", "psi")),
    "p, q swapped": Mutation(changes=_swap("p", "q")),
    "q, r swapped": Mutation(changes=_swap("q", "r")),
    "p, r swapped": Mutation(changes=_swap("p", "r")),
    "phi, theta swapped": Mutation(changes=_swap("phi", "theta")),
    "attitude 0.3 s late": Mutation(changes=_late(0.3, "phi", "theta", "psi")),
    "attitude 0.1 s late": Mutation(changes=_late(0.1, "phi", "theta", "psi")),
    "gyros 0.3 s late": Mutation(changes=_late(0.3, "p", "q", "r")),
    "psi 0.5 s late": Mutation(changes=_late(0.5, "psi")),
    "p dead": Mutation(dead="p"),
    "q dead": Mutation(dead="q"),
    "r dead": Mutation(dead="r"),
}
MORE_MUTATIONS: dict[str, Mutation] = {
    "phi 0.3 s late": Mutation(changes=_late(0.3, "phi")),
    "theta 0.3 s late": Mutation(changes=_late(0.3, "theta")),
    "q 0.3 s late": Mutation(changes=_late(0.3, "q")),
    "psi in rad": Mutation(changes=_unit("psi")),
    "gyros turned round": Mutation(changes=_swap("p", "q", "r")),
    "steps twice as long": Mutation(changes=(WiringChange(kind="clock", channels=("time",), size=2.0),)),
    "steps half as long": Mutation(changes=(WiringChange(kind="clock", channels=("time",), size=0.5),)),
    "attitude held for 0.16 s": Mutation(
        changes=(WiringChange(kind="held", channels=("phi", "theta", "psi"), size=0.16),)
    ),
    "psi dead": Mutation(dead="psi"),
}


def mutated(record: Record, changes: Iterable[WiringChange]) -> Record:
    """Return a record from which some changes have to be undone.

    >>> record = Record([[1.0, 5.0], [2.0, 6.0], [3.0, 7.0]], channels=["p", "q"], sample_period_s=0.1)
    >>> mutated(record, [WiringChange(kind="unit", channels=("p",), size=57.3)])["p"].round(3)
    array([0.017, 0.035, 0.052])
    """
    for change in changes:
        if change.kind in ("unit", "clock"):
            change = WiringChange(kind=change.kind, channels=change.channels, size=1.0 / change.size)
        elif change.kind == "late":
            at_s = record.time_s - change.size
            for name in change.channels:
                record = record.replace(name, np.interp(at_s, record.time_s, record[name]))
            continue
        elif change.kind == "held":
            every = round(change.size / record.sample_period_s)
            for name in change.channels:
                record = record.replace(name, record[name][np.arange(len(record)) // every * every])
            continue
        elif change.kind == "swap":
            change = WiringChange(kind="swap", channels=change.channels[::-1])
        record = undone(record, [change])
    return record


def is_cause(mutation: Mutation, changes: Iterable[WiringChange], *, room_s: float = 0.08) -> bool:
    """Tell whether a cause is what was done: the same changes of the same channels, lags and factors about as large."""
    told = sorted(changes, key=_key)
    return any(
        [_key(change) for change in told] == [_key(change) for change in sorted(meant, key=_key)]
        and all(_alike(*pair, room_s) for pair in zip(told, sorted(meant, key=_key), strict=True))
        for meant in (mutation.changes, mutation.mirrored)
        if meant
    )


def _key(change: WiringChange) -> tuple[str, tuple[str, ...]]:
    return change.kind, change.channels


def _alike(told: WiringChange, meant: WiringChange, room_s: float) -> bool:
    if meant.kind == "late":
        return abs(told.size - meant.size) <= room_s
    return abs(told.size - meant.size) <= 0.15 * abs(meant.size)
