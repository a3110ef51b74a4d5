"""Parts of a log: within some spans, to identify on, and outside of them, to watch."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from gtmbench.errors import InputError
from gtmbench.intake.flight_log import FlightLog
from gtmbench.record import Record, Span

_FIRST_SHARE, _FIRST_MOST_S = 0.4, 300.0


def whole_s(log: FlightLog) -> Span:
    """Return when a log begins and ends."""
    return log.segments[0].start_s, log.segments[-1].end_s


def first_part(log: FlightLog) -> Span:
    """Return the span that is taken as healthy where nobody says what is: 40 % of a log, 300 s at most."""
    start_s, end_s = whole_s(log)
    return start_s, round(start_s + min(_FIRST_SHARE * (end_s - start_s), _FIRST_MOST_S), 2)


def healthy_spans(log: FlightLog, given: Iterable[Span]) -> tuple[Span, ...]:
    """Return spans of a log in time, without open ends; those that overlap are one, so that no sample counts twice.

    Raises
    ------
    InputError
        Where a span holds nothing of the log.
    """
    first_s, last_s = whole_s(log)
    clipped = [(max(start_s, first_s), min(end_s, last_s)) for start_s, end_s in given]
    for span, wanted in zip(clipped, given, strict=True):
        if not any(_cut(segment, *span) for segment in log.segments):
            raise InputError(
                f"{wanted[0]:g}..{wanted[1]:g} s hold nothing of {log.path.name}, which runs from {first_s:g} to "
                f"{last_s:g} s; choose a span inside"
            )
    found: list[Span] = []
    for start_s, end_s in sorted(clipped):
        if found and start_s <= found[-1][1]:
            found[-1] = found[-1][0], max(found[-1][1], end_s)
        else:
            found.append((start_s, end_s))
    return tuple(found)


def within(log: FlightLog, spans: Iterable[Span]) -> list[Record]:
    """Return the parts of a log that lie in some spans."""
    parts = [_cut(segment, *span) for span in spans for segment in log.segments]
    return [part for part in parts if part is not None]


def without(log: FlightLog, spans: Sequence[Span]) -> list[Record]:
    """Return the parts of a log that lie outside of all spans."""
    left = list(log.segments)
    for start_s, end_s in spans:
        pieces = []
        for part in left:
            pieces.append(_cut(part, part.start_s, start_s - 0.5 * part.sample_period_s))
            pieces.append(_cut(part, end_s + 0.5 * part.sample_period_s, part.end_s))
        left = [piece for piece in pieces if piece is not None]
    return left


def _cut(record: Record, start_s: float, end_s: float) -> Record | None:
    """Return the part from start to end, both included; None where there are less than two samples."""
    first_s, last_s = max(start_s, record.start_s), min(end_s, record.end_s)
    if not last_s - first_s >= 0.999999 * record.sample_period_s:  # perhaps no sample
        return None
    part = record.between(first_s, last_s)
    return part if len(part) > 1 else None
