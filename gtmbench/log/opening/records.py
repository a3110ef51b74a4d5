"""A log's records for a detector: opened with its channels; within spans, to identify on, and outside, to watch."""

from __future__ import annotations

import contextlib
import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np

from gtmbench.detectors.assumptions import basis_of
from gtmbench.detectors.bank.bank import check_channels
from gtmbench.detectors.protocol import Detector, Monitor
from gtmbench.errors import InputError
from gtmbench.intake.contents import LogColumn, log_columns
from gtmbench.intake.flight_log import FlightLog
from gtmbench.intake.open import open_log
from gtmbench.intake.read import ReadLog, read_log
from gtmbench.intake.times import unit_hint
from gtmbench.intake.tracks import FEWEST, SHORTEST_S
from gtmbench.intake.units import unit
from gtmbench.log.opening.seconds import rows_by_second
from gtmbench.log.self_check.motion import attitude_rates
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.pieces import pieces
from gtmbench.values.record import FloatArray, Record, Span, runs

_SIX = (*GYROS, *ATTITUDE)
_LOST = 2  # samples in a row
# of a log, at most and at least: what is learnt on where nobody says
_FIRST_SHARE, _FIRST_MOST_S, _LEAST_S = 0.4, 300.0, 60.0
LIVELY_DEG_S = 1.5  # of turning: motion
_OF_LIVELIEST, _LIVELIEST = 0.2, 0.9  # a share of what nine seconds of ten don't exceed
_FEWEST_LIVELY, _LASTS_S = 10, 20.0  # seconds of motion; so many within these last
_MORE = 2.0  # times as much motion
_SOON = 0.05  # of the log: motion from the beginning
_SLOWEST_HZ = 2.5  # of what compares gyros with an attitude: at 2 Hz a dead gyro isn't seen any more
_SLOW_S, _FEWEST = 1.0, 10  # samples so far apart, and so few of them, are a mistaken clock's


def open_for(
    path: str | Path | ReadLog,
    watcher: Detector | Monitor,
    *,
    mapping: Sequence[str] = (),
    rate_hz: float | None = None,
) -> FlightLog:
    """Open a log with the channels that a detector needs; with all of its channels for one that doesn't say.

    For a bank with the witnesses beside them that its diagnoses may read, where the log has any.

    Raises InputError where it can't be read, is too slow, or lacks a channel: saying what looks like it, or which banks
    the log allows.
    """
    basis, read = basis_of(watcher), read_log(path)
    try:
        needs = watcher.channels or (_SIX if basis.is_whole else None)
        log = open_log(read, mapping=mapping, rate_hz=rate_hz, needs=needs, witnesses=basis.witnesses)
    except InputError as error:
        columns: tuple[LogColumn, ...] = ()
        with contextlib.suppress(InputError):
            columns = log_columns(read)
        if columns and not any(column.why_not for column in columns):
            mapped = {text.partition("=")[0].strip() for text in mapping}
            there = mapped | {column.channel for column in columns} | {column.name for column in columns}
            try:
                check_channels(basis.title, watcher.channels, there)
            except InputError as lacking:
                raise InputError(f"{read.path}: {lacking}") from error
        raise
    if basis.kinematic:
        _check_rate(log)
    return log


def _check_rate(log: FlightLog) -> None:
    """Refuse a log that comes too seldom to compare gyros with an attitude; its time may be in another unit."""
    hz = 1.0 / log.sample_period_s
    if hz < _SLOWEST_HZ:
        time = next((source for source in log.sources if source.channel == "time"), None)
        stated = None if time is None else unit(time.unit)
        hint = ""
        if time is not None and stated is not None:
            ms = f"; if its stamps are milliseconds, type --map {shlex.quote(f'time={time.column}:ms')}"
            hint = unit_hint(time.column, stated.factor / hz) or ms
        raise InputError(
            f"{log.path} has {hz:.3g} sample{'s' * (hz != 1.0)} a second; at least {_SLOWEST_HZ:g} are needed, better "
            f"10 or more{hint}"
        )


def whole_s(log: FlightLog) -> Span:
    """Return when a log begins and ends."""
    return log.segments[0].start_s, log.segments[-1].end_s


def first_part(log: FlightLog) -> Span:
    """Return the span that is taken as healthy where nobody says what is: 40 % of a log, 300 s at most."""
    start_s, end_s = whole_s(log)
    return start_s, round(start_s + min(_FIRST_SHARE * (end_s - start_s), _FIRST_MOST_S), 2)


def flying_part(log: FlightLog, moving: Sequence[Record], since_s: float = -np.inf) -> Span:
    """Return the span that is taken as healthy where nobody says what is: the first 40 % of the motion, 300 s at most.

    Taxi, alignment, handling and standing teach nothing: it begins where motion does, and lasts a minute where the log
    does; or where motion begins that lasts, if that holds twice as much of it.
    Motion is what gyros and attitude both tell of, so that no sensor's fault passes for it.

    `moving`: the log with gyros and attitude; without any, it is the log's `first_part`.
    """
    lively = lively_seconds(moving)
    lively = lively[lively >= since_s]
    if len(lively) < _FEWEST_LIVELY:
        return first_part(log)
    first_s = max(whole_s(log)[0], since_s)
    spans = [_part_from(log, first_s, lively[lively >= start_s]) for start_s in (lively[0], _lasting_from_s(lively))]
    first, lasting = (np.count_nonzero((lively >= start_s) & (lively <= end_s)) for start_s, end_s in spans)
    return spans[int(lasting > _MORE * first)]


def lively_seconds(moving: Sequence[Record]) -> FloatArray:
    """Return the seconds in which a log moves: as fast as a fifth of what it does in its liveliest tenth, or faster."""
    seconds_s, turning = turning_by_second(moving)
    if not len(turning):
        return seconds_s
    return seconds_s[turning > max(LIVELY_DEG_S, _OF_LIVELIEST * float(np.quantile(turning, _LIVELIEST)))]


def _part_from(log: FlightLog, first_s: float, lively_s: FloatArray) -> Span:
    """Return the first 40 % of some seconds of motion, a minute at least, where the log has that."""
    last_s = whole_s(log)[1]
    start_s = first_s if lively_s[0] - first_s < _SOON * (last_s - first_s) else float(lively_s[0])
    end_s = float(lively_s[int(_FIRST_SHARE * len(lively_s))]) + 1.0
    least_s = min(_FIRST_SHARE * (last_s - start_s), _LEAST_S)
    return round(start_s, 2), round(start_s + min(max(end_s - start_s, least_s), _FIRST_MOST_S), 2)


def _lasting_from_s(lively_s: FloatArray) -> float:
    """Return when motion begins that lasts: handling before a flight is a few seconds of it, far from all others."""
    within = np.searchsorted(lively_s, lively_s + _LASTS_S) - np.arange(len(lively_s))
    return float(lively_s[int(np.argmax(within >= _FEWEST_LIVELY))])


def turning_by_second(moving: Sequence[Record]) -> tuple[FloatArray, FloatArray]:
    """Return how fast a log turns about each of its seconds, as gyros and attitude both tell, and when."""
    told = [_turning_of(record) for record in moving]
    times_s, turning = (np.concatenate([np.zeros(0), *(each[at] for each in told)]) for at in range(2))
    return times_s, turning


def _turning_of(record: Record) -> tuple[FloatArray, FloatArray]:
    """Return the same of one record; a verdict asks it several times."""
    if record not in _TOLD:
        both = _turning_by_row(record)
        known = np.isfinite(both)
        rows = [rows for _, rows in rows_by_second(record, record.start_s) if known[rows].any()]
        edges = np.array([[part.start, part.stop] for part in rows], dtype=np.int_).ravel()
        of_rows = np.append(np.where(known, np.square(both), 0.0), 0.0), np.append(known, False).astype(np.int_)
        sums, counts = (np.add.reduceat(each, edges)[::2] for each in of_rows) if rows else np.zeros((2, 0))
        _TOLD[record] = record.time_s[edges[::2]], np.sqrt(sums / counts)
    return _TOLD[record]


_TOLD: WeakKeyDictionary[Record, tuple[FloatArray, FloatArray]] = WeakKeyDictionary()


def _turning_by_row(record: Record) -> FloatArray:
    """Return how fast it turns at each row, as gyros and attitude both tell, each about its median."""
    rates = np.empty((3, len(record)))
    for rows in pieces(len(record)):
        first, stop = max(rows.start - 1, 0), min(rows.stop + 1, len(record))  # a slope is that of both beside it
        rates[:, rows] = attitude_rates(record.part(range(first, stop)))[rows.start - first : rows.stop - first].T
    found = np.full(len(record), np.inf)
    for columns in ([record[name] for name in GYROS], list(rates)):
        medians = [np.nanmedian(column) for column in columns]
        for rows in pieces(len(record)):
            of_rows = np.array([column[rows] - median for column, median in zip(columns, medians, strict=True)])
            found[rows] = np.minimum(found[rows], np.linalg.norm(of_rows, axis=0))
    return found


def healthy_spans(log: FlightLog, given: Iterable[Span]) -> tuple[Span, ...]:
    """Return spans of a log in time, without open ends; those that overlap are one, so that no sample counts twice.

    Raises InputError where a span holds nothing of the log, or next to nothing: stamps may be in another unit than was
    thought.
    """
    first_s, last_s = whole_s(log)
    clipped = [(max(start_s, first_s), min(end_s, last_s)) for start_s, end_s in given]
    for span, wanted in zip(clipped, given, strict=True):
        if not any(_cut(segment, *span) for segment in log.segments):
            raise InputError(
                f"{wanted[0]:g}..{wanted[1]:g} s hold nothing of {log.path.name}, which runs from {first_s:g} to "
                f"{last_s:g} s; choose a span inside"
            )
        if log.sample_period_s >= _SLOW_S and span[1] - span[0] < _FEWEST * log.sample_period_s:
            raise InputError(
                f"{wanted[0]:g}..{wanted[1]:g} s hold too few samples of {log.path.name}, which are "
                f"{log.sample_period_s:g} s apart; if its stamps are milliseconds, type --map time=COLUMN:ms"
            )
    spans: list[Span] = []
    for start_s, end_s in sorted(clipped):
        if spans and start_s <= spans[-1][1]:
            spans[-1] = spans[-1][0], max(spans[-1][1], end_s)
        else:
            spans.append((start_s, end_s))
    return tuple(spans)


def within(log: FlightLog, spans: Iterable[Span]) -> list[Record]:
    """Return the parts of a log that lie in some spans."""
    parts = [_cut(segment, *span) for span in spans for segment in log.segments]
    return [part for part in parts if part is not None]


def between_pauses(records: Iterable[Record], channels: Sequence[str]) -> list[Record]:
    """Return some channels of records, cut where one of them misses more than a sample or two: to identify on.

    What is left between pauses is as long as a log's segments are, and begins and ends with values that are known.
    """
    parts = [part for record in records for part in _complete(record.select(channels) if channels else record)]
    if not parts:
        raise InputError(
            f"nothing that is healthy lasts {SHORTEST_S:g} s and {FEWEST} samples with every channel there; give a "
            "longer stretch, or leave out a channel"
        )
    return parts


def _complete(record: Record) -> list[Record]:
    lost = np.asarray(~record.there.all(axis=1))
    starts, ends = runs(lost)
    long = ends - starts > _LOST
    if not long.any():
        return [record]
    bounds = [0, *np.column_stack([starts, ends])[long].ravel().tolist(), len(record)]
    known = np.flatnonzero(np.isfinite(record.values).all(axis=1))
    parts = []
    for first, stop in zip(bounds[::2], bounds[1::2], strict=True):
        rows = known[(known >= first) & (known < stop)]
        if len(rows) and rows[-1] - rows[0] >= max(FEWEST, SHORTEST_S / record.sample_period_s):
            parts.append(record.between(record.time_s[rows[0]], record.time_s[rows[-1]]))
    return parts


def without(log: FlightLog, spans: Sequence[Span]) -> list[Record]:
    """Return the parts of a log that lie outside of all spans."""
    return outside(log.segments, spans)


def outside(records: Iterable[Record], spans: Iterable[Span]) -> list[Record]:
    """Return the parts of records that lie outside of all spans."""
    left = list(records)
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
