"""Vectors of the folder's own test: readings that are made up, and what Python says of them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gtmbench.detectors.bank.calibrated import CalibratedBank, bank_residuals
from gtmbench.detectors.monitor.scores import bank_alarms
from gtmbench.detectors.statistics.learnt_noise import follower
from gtmbench.detectors.statistics.statistic import RawScore
from gtmbench.export.board import Board
from gtmbench.faults.fault import inject
from gtmbench.faults.kinds.additive import Bias
from gtmbench.method.pseudo_inputs import derived
from gtmbench.values.channels import CHANNELS
from gtmbench.values.record import FloatArray, Record

MISSING = -32768
_SECONDS, _ONSET_S, _HOLE_S = 21.0, 18.5, 17.0
_LEARNT = 2.5  # times what is learnt on first: then the C has caught up
_CHECKS = 12
_LONGEST_ROWS = 20_000  # of vectors: the test has to fit into a flight controller's flash
_DEVIATIONS = 12.0  # of the residual: the fault that the test puts in


@dataclass(frozen=True, kw_only=True, eq=False)
class Vectors:
    """Readings, and what is expected of them."""

    # shape (rows, channels); in steps; `MISSING` where one is missing
    readings: np.ndarray[tuple[int, int], np.dtype[np.int_]] = field(repr=False)
    steps: FloatArray  # shape (channels,); in the channels' units
    # shape (checks,); rows of the readings after which the rest is compared
    rows: np.ndarray[tuple[int], np.dtype[np.int_]]
    # shape (checks, residuals, windows, 2); of mean and energy, over their thresholds; NaN where there is none
    statistics: FloatArray = field(repr=False)
    residuals: FloatArray = field(repr=False)  # shape (checks, residuals); in the outputs' units
    # shape (residuals,); the row with which each is first above its threshold; -1 where none is
    alarms: np.ndarray[tuple[int], np.dtype[np.int_]]


def statistics_of(monitor: CalibratedBank, board: Board, output: str, raw: FloatArray) -> FloatArray:
    """Return statistics over their thresholds, shape (rows, windows, 2): mean, energy; NaN where nothing is tested."""
    white = follower(monitor.whiteners[output], board.period_s).push(raw)
    test, thresholds = monitor.bank.statistic, monitor.thresholds[output]
    told = np.full((len(raw), len(board.windows), 2), np.nan)
    scores: dict[str, RawScore] = {
        score.label: score
        for score in test.scores(raw[: len(white)], white, board.period_s, monitor.tolerances[output])
    }
    for w, rows in enumerate(board.windows):
        for kind, name in enumerate(("mean", "energy")):
            label = f"{name} {rows * board.period_s:g} s"
            told[: len(white), w, kind] = scores[label].values / thresholds[label]
    return told


def vectors_of(monitor: CalibratedBank, board: Board) -> Vectors:
    """Return vectors for a monitor: a healthy flight that is made up, with a hole, and a bias at its end."""
    period_s = board.period_s
    late = max(_ONSET_S / period_s, board.least_baseline + board.windows[0] + _LEARNT * 14 * board.block)
    rows = min(round(late + (_SECONDS - _ONSET_S) / period_s), _LONGEST_ROWS)
    readings, steps, record = _quantised(_flown(monitor, board, rows), board, (rows - round(2.5 / period_s)) * period_s)
    residuals = bank_residuals(monitor, record).raw
    first = round(_LEARNT * 14 * board.block) + max(each.ahead for each in board.residuals)
    checks = np.unique(np.linspace(first, rows - 1, _CHECKS).astype(int))
    statistics, expected = [], []
    for each in board.residuals:
        at = checks - each.ahead
        statistics.append(statistics_of(monitor, board, each.output, residuals[each.output])[at])
        expected.append(residuals[each.output][at])
    first_s: dict[str, float] = {}
    for crossing in bank_alarms(monitor, record):
        first_s.setdefault(crossing.output, crossing.time_s)
    crossed = {output: round((time_s - record.start_s) / period_s) for output, time_s in first_s.items()}
    there = np.isfinite(np.stack(statistics, axis=1)[:, :, 0, 0]).all(axis=1)  # beside a hole nothing is judged
    return Vectors(
        readings=readings,
        steps=steps,
        rows=checks[there],
        statistics=np.stack(statistics, axis=1)[there],
        residuals=np.stack(expected, axis=1)[there],
        alarms=np.array([crossed.get(each.output, -1) for each in board.residuals]),
    )


def _flown(monitor: CalibratedBank, board: Board, rows: int) -> Record:
    """Return readings of a made-up flight; gyros read what the attitude turns by, and noise."""
    random, time_s = np.random.default_rng(1), np.arange(rows + 2) * board.period_s
    waves = {"phi": (0.0, 8.0, 1.1), "theta": (4.0, 3.0, 1.7), "psi": (60.0, 12.0, 0.5)}
    angles = {name: middle + size * np.sin(turn * time_s + turn) for name, (middle, size, turn) in waves.items()}
    attitude = Record(np.column_stack([*angles.values()]), channels=[*angles], sample_period_s=board.period_s)
    rates = dict(zip("pqr", derived(attitude, ("p_att", "q_att", "r_att")), strict=True))
    columns = []
    for i, name in enumerate(board.channels):
        told = {**angles, **rates}.get(name, 5.0 + np.sin(0.7 * time_s + i))[1:-1]
        own = monitor.operators.get(name)
        noise = float(own.rms_residual[0]) if own is not None else CHANNELS[name].noise
        columns.append(told + noise * random.standard_normal(rows))
    return Record(np.column_stack(columns), channels=board.channels, sample_period_s=board.period_s)


def _quantised(
    record: Record, board: Board, onset_s: float
) -> tuple[np.ndarray[tuple[int, int], np.dtype[np.int_]], FloatArray, Record]:
    """Return readings in whole steps, the steps, and the record that they are; with a hole, and broken at the end."""
    broken = board.channels[0]
    size = _DEVIATIONS * float(np.std(record[broken] - np.convolve(record[broken], np.ones(5) / 5.0, mode="same")))
    values = inject(record, Bias(channel=broken, onset_s=onset_s, size=size)).matrix(board.channels).copy()
    hole = round(_HOLE_S / board.period_s)
    values[hole : hole + 2] = np.nan
    values[hole + 40 : hole + 41, 0] = np.nan
    steps = np.float32(1.05 * np.nanmax(np.abs(values), axis=0) / 32_000.0).astype(float)
    whole = np.where(np.isnan(values), MISSING, np.round(values / steps)).astype(int)
    values = np.where(whole == MISSING, np.nan, (whole * steps).astype(np.float32))
    return whole, steps, Record(values, channels=board.channels, sample_period_s=board.period_s)
