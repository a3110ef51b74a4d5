"""What a bank tells apart, in words: by which residuals rise, only by how they rise, or not at all."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

from gtmbench.checks import listed
from gtmbench.detectors.bank.isolability import BY_SHAPE, NOT_TOLD, Isolability


def isolation_lines(told: Isolability) -> list[str]:
    """Say which residuals a fault of each suspect raises, and what isn't told by that.

    >>> from gtmbench.detectors.bank.bank import load_bank
    >>> from gtmbench.detectors.bank.isolability import isolability
    >>> for line in isolation_lines(isolability(load_bank("C"))):
    ...     print(line)
    isolable by which residuals rise: p (p), q (q), r (r), phi, theta and psi (p, q and r)
    isolable only by how they rise: p, q and r from phi, theta and psi; phi, theta and psi from each other
    """
    groups: dict[tuple[str, ...], list[str]] = {}
    for name, outputs in told.enters.items():
        groups.setdefault(outputs, []).append(name)
    lines = []
    if len(groups) > 1:
        said = (f"{listed(names)} ({listed(outputs)})" for outputs, names in groups.items())
        lines.append(f"isolable by which residuals rise: {', '.join(said)}")
    if alike := "; ".join(_by_shape(told)):
        lines.append(f"isolable only by how they rise: {alike}")
    if mistaken := "; ".join(_indistinguishable(told)):
        unknown = listed([name for name in told.suspects if name not in told.predicted])
        lines.append(f"not isolable: {mistaken}, because nothing predicts {unknown}")
    return lines


def _by_shape(told: Isolability) -> Iterator[str]:
    """Say who is told from whom only by how residuals rise: from those whose faults raise more, and from the like."""
    like, more = defaultdict(list), defaultdict(list)
    for one in told.suspects:
        others = [other for other in told.suspects if other != one and told.told(one, other) == BY_SHAPE]
        alike = {other for other in others if told.enters[other] == told.enters[one]}
        if alike:
            like[told.enters[one]].append(one)
        if wider := tuple(other for other in others if other not in alike):
            more[wider].append(one)
    yield from (f"{listed(ones)} from {listed(others)}" for others, ones in more.items())
    yield from (f"{listed(names)} from each other" for names in like.values())


def _indistinguishable(told: Isolability) -> Iterator[str]:
    """Say whose fault can't be told from that of a suspect which nothing predicts."""
    unknown = [name for name in told.suspects if name not in told.predicted]
    mistaken, mixed = defaultdict(list), []
    for one in unknown:
        others = [other for other in told.suspects if other != one and NOT_TOLD in _both_ways(told, one, other)]
        if known := tuple(name for name in others if name in told.predicted):
            mistaken[known].append(one)
        if len(known) < len(others):
            mixed.append(one)
    yield from (f"{listed(known)} from {listed(ones)}" for known, ones in mistaken.items())
    if mixed:
        yield f"{listed(mixed)} from each other"


def _both_ways(told: Isolability, one: str, other: str) -> tuple[str, str]:
    return told.told(one, other), told.told(other, one)
