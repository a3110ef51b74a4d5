"""What a bank is identified on, of healthy logs: not resets, nor the ground, nor where the attitude isn't right yet.

An attitude that is set anew, isn't aligned, or doesn't follow a touchdown is no model error of flight: identified on,
it makes a residual ten times as large, and faults pass beneath. What is left out is said, span by span.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gtmbench.detectors.bank.bank import Bank, ResidualSpec
from gtmbench.detectors.bank.calibrated import residuals_of
from gtmbench.detectors.bank.calibration import check_long, identified
from gtmbench.detectors.bank_detector import BankDetector
from gtmbench.detectors.protocol import Detector
from gtmbench.errors import InputError
from gtmbench.intake.events import EventKind, of_kind
from gtmbench.intake.flight_log import FlightLog
from gtmbench.log.opening.records import between_pauses
from gtmbench.method.estimators.bayesian import Bayesian
from gtmbench.values.record import BoolArray, FloatArray, Record, Span

_AROUND_S = 2.5  # a reset, and before a touchdown is told
_LEAST_LEFT, _LEAST_MOTION = 2.0 / 3.0, 0.5  # of the samples, of the motion's energy
_LEAST_S = 15.0  # of what is learnt on
_ENOUGH_S = (
    60.0  # of flight: with less, what stood on the ground stays; it is calm, and thresholds stand on every second
)
_LEAST_THERE = 2.0 / 3.0  # of a stretch
_LONG_ENOUGH = 0.2  # of the longest stretch
_SHORTEST_S = 5.0  # that a bank is calibrated on
_BLOCK_S, _FEWEST = 2.0, 6  # a block; so many say what is usual
_BEYOND = 6.0  # times what such motion leaves elsewhere
_TOUCHING_S = 0.25  # stretches so close are one
_ALIKE, _MOST_ALIKE = 1.0 / 3.0, 300  # of the blocks: those whose motion is nearest; so many say a median to 7 %

RESET, GROUND = "an estimator's reset", "on the ground"
RESIDUAL = f"their residuals are more than {_BEYOND:g} times what such motion leaves elsewhere"


@dataclass(frozen=True, kw_only=True)
class LeftOut:
    """A span of a log that isn't identified on."""

    log: Path
    span: Span
    why: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Stretches:
    """What is identified on."""

    records: tuple[Record, ...]
    logs: tuple[FlightLog, ...]  # the log of each
    left_out: tuple[LeftOut, ...] = ()

    @property
    def samples(self) -> int:
        """How many there are, but for those left out."""
        return sum(int(np.count_nonzero(_there(record))) for record in self.records)

    @property
    def dense(self) -> bool:
        """Whether of every stretch enough is there."""
        return all(_there(record).mean() >= _LEAST_THERE for record in self.records)

    @property
    def reasons(self) -> list[str]:
        """What was left out, a line a log and a reason."""
        lines = []
        for path, why in dict.fromkeys((each.log, each.why) for each in self.left_out):
            spans = _joined([each.span for each in self.left_out if (each.log, each.why) == (path, why)])
            said = ", ".join(f"{start_s:.1f}..{end_s:.1f} s" for start_s, end_s in spans)
            lines.append(f"{path.name}: {said} left out of identification: {why}")
        return lines

    def left_out_of(self, log: FlightLog) -> list[Span]:
        """Return the spans of a log that are left out."""
        return [each.span for each in self.left_out if each.log == log.path]

    def without(self, doubt: LeftOut) -> Stretches:
        """Return them without a span; too short a rest goes, too."""
        pairs = [
            (piece, log)
            for record, log in zip(self.records, self.logs, strict=True)
            for piece in (_without(record, doubt.span) if log.path == doubt.log else [record])
        ]
        return replace(
            self,
            records=tuple(record for record, _ in pairs),
            logs=tuple(log for _, log in pairs),
            left_out=(*self.left_out, doubt),
        )


def healthy_stretches(
    parts: Sequence[tuple[FlightLog, Sequence[Record]]], channels: Sequence[str]
) -> tuple[Stretches, list[str]]:
    """Return the stretches of some logs between pauses, and a word on those that are too short beside the longest.

    Too short is a fifth of it, or what a bank isn't calibrated on, 5 s.
    """
    found: list[tuple[Record, FlightLog]] = []
    for log, records in parts:
        with contextlib.suppress(InputError):  # nothing of this log
            found += [(piece, log) for piece in between_pauses(records, channels)]
    if not found:
        between_pauses([], channels)
    longest_s = max(_length_s(piece) for piece, _ in found)
    shortest_s = max(_LONG_ENOUGH * longest_s, min(_SHORTEST_S, longest_s))
    kept = [(piece, log) for piece, log in found if _length_s(piece) >= shortest_s - 1e-9]
    stretches = Stretches(records=tuple(piece for piece, _ in kept), logs=tuple(log for _, log in kept))
    if len(kept) == len(found):
        return stretches, []
    return stretches, [
        f"{len(found) - len(kept)} of {len(found)} healthy stretches weren't identified on: shorter than "
        + ("a fifth of the longest" if shortest_s > _SHORTEST_S else f"{_SHORTEST_S:g} s")
    ]


def undisturbed(detector: Detector, stretches: Stretches) -> Stretches:
    """Return healthy stretches without what isn't flight with a settled attitude; of a bank that compares with one.

    First goes what logs tell by events: what is about an estimator's reset, and on the ground where a minute of flight
    is left. Then the bank is identified, and blocks go whose residual is large beside what the same motion leaves
    elsewhere. At most a third of the samples goes, and no more than half of the motion.
    """
    bank = detector.bank if isinstance(detector, BankDetector) else None
    if bank is None or not _kinematic(bank):
        return stretches
    check_long(stretches.records)
    period_s = stretches.records[0].sample_period_s
    least = max(_LEAST_LEFT * stretches.samples, _LEAST_S / period_s)
    for doubt in _stretches_left_out(stretches):
        left = stretches.without(doubt)
        enough = max(least, _ENOUGH_S / period_s) if doubt.why == GROUND else least
        stretches = left if left.dense and enough <= left.samples < stretches.samples else stretches
    motion_left = 1.0
    for doubt, share in _beyond(stretches, bank, _BEYOND):
        left = stretches.without(doubt)
        kept = left.dense and left.samples >= least and len(left.records) == len(stretches.records)
        if kept and motion_left - share >= _LEAST_MOTION:
            stretches, motion_left = left, motion_left - share
    return stretches


def _kinematic(bank: Bank) -> list[ResidualSpec]:
    return [spec for spec in bank.residuals if spec.is_kinematic]


def _without(record: Record, span: Span) -> list[Record]:
    """Return a record of which a span is missing, so that its length, which thresholds go by, stays."""
    inside = (record.time_s >= span[0]) & (record.time_s <= span[1])
    if not inside.any():
        return [record]
    left = Record(
        np.where(inside[:, np.newaxis], np.nan, record.values),
        channels=record.channels,
        sample_period_s=record.sample_period_s,
        start_s=record.start_s,
        there=record.there & ~inside[:, np.newaxis],
    )
    return _trimmed(left)


def _trimmed(record: Record) -> list[Record]:
    """Return a record from the first to the last row that is there; nothing where that is short."""
    rows = np.flatnonzero(_there(record))
    if not len(rows) or record.time_s[rows[-1]] - record.time_s[rows[0]] < _SHORTEST_S:
        return []
    return [record.between(record.time_s[rows[0]], record.time_s[rows[-1]])]


def _there(record: Record) -> BoolArray:
    return np.asarray(np.isfinite(record.values).any(axis=1), dtype=np.bool_)


def _joined(spans: Sequence[Span]) -> list[Span]:
    """Return spans in time; those that touch are one."""
    joined: list[Span] = []
    for start_s, end_s in sorted(spans):
        if joined and start_s <= joined[-1][1] + _TOUCHING_S:
            joined[-1] = joined[-1][0], max(joined[-1][1], end_s)
        else:
            joined.append((start_s, end_s))
    return joined


def _stretches_left_out(stretches: Stretches) -> list[LeftOut]:
    """Return what the logs' events tell: first resets, then what is on the ground."""
    told: dict[str, list[LeftOut]] = {RESET: [], GROUND: []}
    for log in {id(log): log for log in stretches.logs}.values():
        own = [record for record, its in zip(stretches.records, stretches.logs, strict=True) if its is log]
        resets = [event.time_s for event in of_kind(log.events, EventKind.RESET)]
        spans = {RESET: [(time_s - _AROUND_S, time_s + _AROUND_S) for time_s in resets], GROUND: _on_ground(log)}
        for why, found in spans.items():
            for span in found:
                start_s, end_s = max(span[0], own[0].start_s), min(span[1], own[-1].end_s)
                if start_s < end_s:
                    told[why].append(LeftOut(log=log.path, span=(start_s, end_s), why=why))
    return [*told[RESET], *told[GROUND]]


def _on_ground(log: FlightLog) -> list[Span]:
    """Return the spans until a takeoff, and from a touchdown to the next, as far as events tell."""
    changes = of_kind(log.events, EventKind.TAKEOFF, EventKind.TOUCHDOWN)
    took_off = [event.kind is EventKind.TAKEOFF for event in changes]
    spans = [(-np.inf, changes[0].time_s)] if took_off[:1] == [True] else []
    for number, event in enumerate(changes):
        if not took_off[number] and (number == 0 or took_off[number - 1]):
            up_s = next(
                (later.time_s for later, up in zip(changes[number:], took_off[number:], strict=True) if up), np.inf
            )
            spans.append((event.time_s - _AROUND_S, up_s))
    return spans


def _beyond(stretches: Stretches, bank: Bank, times: float) -> list[tuple[LeftOut, float]]:
    """Return the blocks whose residuals are too large beside their motion, worst first, and their share of motion."""
    spans, logs, squares = [], [], []
    operators = {spec.output: identified(stretches.records, spec, Bayesian())[0] for spec in _kinematic(bank)}
    for record, log in zip(stretches.records, stretches.logs, strict=True):
        residuals = residuals_of(bank, record, operators, operators)
        columns = [(residuals.raw[name], residuals.predicted[name], record[name]) for name in operators]
        left, predicted, read = np.square(np.array(columns)).transpose(1, 2, 0)
        for rows in np.array_split(
            np.arange(len(record)), min(len(record), max(1, round(_length_s(record) / _BLOCK_S)))
        ):
            there = rows[np.isfinite(left[rows]).all(axis=1)]
            if len(there) >= 0.5 * len(rows):
                motion = min(predicted[there].sum(axis=1).mean(), read[there].sum(axis=1).mean())
                squares.append([*left[there].mean(axis=0), motion])
                spans.append((record.time_at(rows[0]), record.time_at(rows[-1])))
                logs.append(log.path)
    if len(squares) < _FEWEST:
        return []
    blocks = np.sqrt(np.array(squares))
    beyond = ratios(blocks[:, :-1], blocks[:, -1])
    energy = blocks[:, -1] ** 2 / max(float(np.sum(blocks[:, -1] ** 2)), 1e-300)
    worst = [int(place) for place in np.argsort(-beyond) if beyond[place] > times]
    return [(LeftOut(log=logs[place], span=spans[place], why=RESIDUAL), float(energy[place])) for place in worst]


def _length_s(record: Record) -> float:
    return len(record) * record.sample_period_s


def ratios(residuals: FloatArray, motion: FloatArray) -> FloatArray:
    """Return how many times larger each block's residual is than blocks of about its motion have it.

    A model errs in proportion to motion: what less motion leaves is scaled up, what more motion leaves isn't scaled
    down.

    `residuals`: RMS values, shape (blocks, outputs); the ratio of a block is that of the output for which it is
    largest. `motion`: shape (blocks,).

    >>> ratios(np.array([[1.0], [1.0], [2.0], [9.0], [1.0], [1.0], [1.0]]), np.array([1.0, 1, 2, 1, 1, 1, 1]))
    array([1., 1., 1., 9., 1., 1., 1.])
    """
    nearest = min(max(3, round(_ALIKE * len(motion))), _MOST_ALIKE)
    size = np.log(np.maximum(motion, 1e-9))
    by_size = np.argsort(size, kind="stable")
    found = np.zeros(len(motion))
    for at, place in enumerate(by_size):
        around = by_size[max(at - nearest, 0) : at + nearest + 1]
        by_distance = around[np.argsort(np.abs(size[around] - size[place]), kind="stable")]
        others = by_distance[by_distance != place][:nearest]
        more = np.maximum(1.0, np.exp(size[place] - size[others]))
        expected = np.median(residuals[others] * more[:, np.newaxis], axis=0)
        found[place] = np.max(residuals[place] / np.maximum(expected, 1e-12))
    return found
