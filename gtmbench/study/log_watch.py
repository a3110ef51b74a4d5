"""Watching a recorded flight: a monitor identified on one part of it (or on other logs), or ready-made, and the rest."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from gtmbench.errors import InputError
from gtmbench.files import shipped_banks
from gtmbench.intake.flight_log import FlightLog
from gtmbench.method.monitoring.bank import Bank, bank_of, load_bank
from gtmbench.method.monitoring.cautious_calibration import calibrate_cautiously
from gtmbench.method.monitoring.monitor import Monitor
from gtmbench.method.monitoring.watch import Watch, watch
from gtmbench.method.pose import operator_names
from gtmbench.method.pseudo_inputs import PSEUDO_INPUTS, raw_needs
from gtmbench.record import Record, Span
from gtmbench.study.watched_log import WatchedLog

_FIRST_SHARE = 0.4  # of a log, taken as healthy where nobody says what is
_FIRST_MOST_S = 300.0
_WIDE = 3.0  # spread of a residual beyond which little shows
_MUCH = 0.1  # share of the time
Progress = Callable[[str, int, int], None]


def bank_between(inputs: Sequence[str], outputs: Sequence[str], look_s: float) -> Bank:
    """Return a bank of operators from some channels to others, each with the energy of its residual as its alarm.

    >>> bank = bank_between(["p", "q", "beta"], ["r"], 0.5)
    >>> bank.name, bank.suspects
    ('[p q beta] -> r', ('r', 'p', 'q', 'beta'))
    """
    u, y = operator_names(inputs, outputs)
    residuals = [{"output": output, "inputs": list(u), "look_back_s": look_s, "look_ahead_s": look_s} for output in y]
    raw = dict.fromkeys(name for given in (*y, *u) for name in sorted(raw_needs(given)))
    alarm = {"statistic": "energy", "windows_s": [0.5, 2.0], "two_sided": False}
    name = f"[{' '.join(u)}] -> {' '.join(y)}"
    return bank_of(
        name, {"title": "identified on this log", "suspects": list(raw), "residuals": residuals, "alarm": alarm}
    )


def first_part(log: FlightLog) -> Span:
    """Return the part of a log that is taken as healthy where nobody says which is: its first 40 %, 300 s at most."""
    start_s, end_s = log.segments[0].start_s, log.segments[-1].end_s
    return start_s, start_s + min(_FIRST_SHARE * (end_s - start_s), _FIRST_MOST_S)


def within(log: FlightLog, spans: Iterable[Span]) -> list[Record]:
    """Return the parts of a log that lie in some spans.

    Raises
    ------
    InputError
        Where a span holds nothing of the log.
    """
    found = []
    for start_s, end_s in spans:
        parts = [_cut(segment, start_s, end_s) for segment in log.segments]
        there = [part for part in parts if part is not None]
        if not there:
            raise InputError(
                f"{start_s:g}..{end_s:g} s holds nothing of {log.path.name}, which runs from "
                f"{log.segments[0].start_s:g} to {log.segments[-1].end_s:g} s; choose a span inside"
            )
        found += there
    return found


def identified_on(
    records: Sequence[Record], bank: Bank, *, rate: float, provenance: dict[str, object], progress: Progress
) -> Monitor:
    """Identify and calibrate a bank on healthy stretches, those that are too short left out."""
    long = [record for record in records if (len(record) - 1) * record.sample_period_s >= 0.2 * _longest_s(records)]
    return calibrate_cautiously(long, bank, false_alarms_per_hour=rate, provenance=provenance, progress=progress)


def watch_log(
    log: FlightLog,
    monitor: Monitor,
    *,
    identified_s: Sequence[Span] = (),
    reasons: Sequence[str] = (),
    progress: Progress = lambda _step, _done, _of: None,
) -> WatchedLog:
    """Watch every segment of a log but the spans that the monitor was identified on.

    Parameters
    ----------
    log : FlightLog
        At the monitor's sample rate, with its bank's channels.
    monitor : Monitor
    identified_s : sequence of (start, end)
        Not watched.
    reasons : sequence of str
        What limits what can be said.
    progress : callable
        Told the step, how many are done, and of how many.

    Raises
    ------
    InputError
        Where the log lacks a channel of the bank or has another sample period.
    """
    parts = [part for segment in log.segments for part in _without(segment, identified_s)]
    watches = []
    for done, part in enumerate(parts):
        progress("watch", done, len(parts))
        seen = watch(monitor, part)
        # the series behind the levels are most of the memory
        levels = {output: replace(level, series=()) for output, level in seen.levels.items()}
        watches.append(replace(seen, levels=levels))
    progress("watched", len(parts), len(parts))
    return WatchedLog(
        log=log,
        monitor=monitor,
        identified_s=tuple(identified_s),
        watches=tuple(watches),
        reasons=(*reasons, *_limits(watches)),
    )


def possible(channels: Iterable[str]) -> list[str]:
    """Say which banks and pseudo inputs some channels allow, and what the others lack."""
    there = set(channels)
    lines = []
    for name in shipped_banks():
        bank = load_bank(name)
        missing = [channel for channel in bank.channels if channel not in there]
        lines.append(f"bank {name}: " + (f"no, {', '.join(missing)} missing" if missing else f"possible, {bank.title}"))
    derivable = [name for name in PSEUDO_INPUTS if raw_needs(name) <= there]
    return [*lines, f"pseudo inputs: {', '.join(derivable) or 'none'}"]


def _limits(watches: Sequence[Watch]) -> list[str]:
    """Say what limits what was seen."""
    wide, rows = 0, 0
    for seen in watches:
        for spread in seen.residuals.spread.values():
            wide += int(np.count_nonzero(spread.white > _WIDE))
            rows += len(spread.white)
    if not rows or wide < _MUCH * rows:
        return []
    return [
        f"{100.0 * wide / rows:.0f} % of the time the motion was beyond what identification held: faults show less there"
    ]


def _longest_s(records: Sequence[Record]) -> float:
    return max((len(record) - 1) * record.sample_period_s for record in records)


def _without(segment: Record, spans: Sequence[Span]) -> list[Record]:
    """Return what of a segment lies outside all spans."""
    left = [segment]
    for start_s, end_s in spans:
        pieces = []
        for part in left:
            step = part.sample_period_s
            pieces += [_cut(part, part.start_s, min(start_s - step, part.end_s))] if start_s > part.start_s else []
            pieces += [_cut(part, max(end_s + step, part.start_s), part.end_s)] if end_s < part.end_s else []
        left = [piece for piece in pieces if piece is not None]
    return left


def _cut(record: Record, start_s: float, end_s: float) -> Record | None:
    """Return the part from start to end, both included; None where there are less than two samples."""
    first, last = max(start_s, record.start_s), min(end_s, record.end_s)
    return record.between(first, last) if last - first >= 1.5 * record.sample_period_s else None
