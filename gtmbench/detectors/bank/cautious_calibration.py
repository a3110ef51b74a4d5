"""Calibration on little: a monitor from half a minute of flight, or a few such records.

Every stretch is judged by operators that haven't seen it, and the monitor's own stand on all of them. What the records
leave open is carried along as doubt, so that another manoeuvre doesn't alarm for being another.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from gtmbench.detectors.bank.bank import Bank, ResidualSpec
from gtmbench.detectors.bank.calibrated import CalibratedBank, residuals_of
from gtmbench.detectors.bank.cautious import identify_cautiously
from gtmbench.detectors.bank.doubt import Doubt
from gtmbench.detectors.bank.spread import Spread
from gtmbench.detectors.bank.statistics import tolerance_of
from gtmbench.detectors.bank.tails import rate_bound
from gtmbench.detectors.bank.thresholds import thresholds_of
from gtmbench.detectors.bank.whitening import Whitener, fit_whitener
from gtmbench.errors import InputError
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.record import FloatArray, Record, frozen

_FOLDS = 5  # stretches of one or two records; of more, each record is one
_MOST_FOLDS = 10
_NOISE_POWER = 2.0  # by which the noise of another stretch may be stronger
_MARGIN = 2.0  # on thresholds of energies: mostly the model's error, which other motion may well double
_BASELINES = 5.0  # in the shortest record
_MOST = 20.0  # deviations that one sample may count for
_FACTORS = np.concatenate([[1.0], np.geomspace(1.2, 300.0, 40)])
_SHORTEST_S = 5.0
_LOOKS = 20.0  # so many times what an operator looks back and ahead, at least
_LEAST_THERE = 0.5  # of the residual
Rows = tuple[int, slice]  # of a record, by its number


def calibrate_cautiously(
    records: Sequence[Record],
    bank: Bank,
    *,
    false_alarms_per_hour: float,
    provenance: Mapping[str, Any] | None = None,
    progress: Callable[[str, int, int], None] = lambda _step, _done, _of: None,
) -> CalibratedBank:
    """Identify a bank on short healthy records and set its thresholds on stretches that identification hadn't seen.

    Too little energy doesn't alarm, means are compared with those of the last fifth of a record, and the noise may be
    twice as strong as seen: a short record doesn't tell how steady it is.

    Parameters
    ----------
    records : sequence of Record
        With the bank's channels, all of one sample period.
    bank : Bank
    false_alarms_per_hour : float
    provenance, progress
        As for `calibrate`.

    Raises
    ------
    InputError
        Where a channel is constant or the records are too short.
    """
    period_s = records[0].sample_period_s
    shortest_s = min(map(len, records)) * period_s
    if shortest_s < _SHORTEST_S:
        raise InputError(
            f"a healthy record of {shortest_s:.3g} s is too short to calibrate on; give at least {_SHORTEST_S:g} s, "
            "better minutes"
        )
    _check_length(bank, sum(map(len, records)) * period_s)
    baseline_s = min(bank.statistic.baseline_s, shortest_s / _BASELINES)
    bank = replace(bank, statistic=replace(bank.statistic, baseline_s=baseline_s, two_sided=False))
    learnt = {}
    for done, spec in enumerate(bank.residuals):
        progress(f"identify {spec.output}", done, len(bank.residuals) + 1)
        learnt[spec.output] = _learn(bank, spec, records)
    progress("thresholds", len(bank.residuals), len(bank.residuals) + 1)
    seen = {output: one.seen for output, one in learnt.items()}
    tolerances = {}
    for output, pairs in seen.items():
        found = tolerance_of([white / spread.white for _, white, spread in pairs], bank.statistic, period_s, noise=4.0)
        tolerances[output] = replace(found, high=max(found.high, _NOISE_POWER))
    thresholds, block_s = thresholds_of(bank.statistic, seen, tolerances, period_s, false_alarms_per_hour)
    if bank.statistic.name == "energy":
        thresholds = {output: {label: _MARGIN * of for label, of in own.items()} for output, own in thresholds.items()}
    hours = sum(map(len, records)) * period_s / 3600.0
    progress("done", len(bank.residuals) + 1, len(bank.residuals) + 1)
    return CalibratedBank(
        bank=bank,
        operators={output: one.operator for output, one in learnt.items()},
        whiteners={output: one.whitener for output, one in learnt.items()},
        tolerances=tolerances,
        thresholds=thresholds,
        doubts={output: one.doubt for output, one in learnt.items()},
        sample_period_s=period_s,
        provenance={
            **(provenance or {}),
            "records": len(records),
            "identification_hours": hours,
            "threshold_hours": hours,
            "block_s": block_s,
            "false_alarms_per_hour": false_alarms_per_hour,
            "false_alarms_per_hour_at_most": rate_bound(0, hours),
        },
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Learnt:
    """One residual; `seen`: raw, whitened and their spread, by operators that hadn't seen them, one a record."""

    operator: Transmissibility
    whitener: Whitener
    doubt: Doubt
    seen: list[tuple[FloatArray, FloatArray, Spread]] = field(repr=False)


def _learn(bank: Bank, spec: ResidualSpec, records: Sequence[Record]) -> _Learnt:
    whole = identify_cautiously(records, spec)
    operators = {spec.output: whole.operator}
    residuals = [residuals_of(bank, record, operators, [spec.output]).raw[spec.output] for record in records]
    order = round(bank.whitening_s / records[0].sample_period_s)
    whitener = fit_whitener(residuals, order=min(order, sum(map(len, records)) // 50))
    raw = [np.full(len(record), np.nan) for record in records]
    white, of_raw, of_white = ([np.array(values) for values in raw] for _ in range(3))
    of_means: list[dict[int, FloatArray]] = [{} for _ in records]
    for others, held in _folds(records):
        part = identify_cautiously(others, spec, rms=whole.rms)
        for number, rows in held:
            record = records[number]
            residual = residuals_of(bank, record, {spec.output: part.operator}, [spec.output]).raw[spec.output]
            spread = Doubt(root=part.root, raw=1.0, white=1.0).spread(
                part.operator, record, whitener.coefficients, bank.statistic
            )
            raw[number][rows], white[number][rows] = residual[rows], whitener.whiten(residual)[rows]
            of_raw[number][rows], of_white[number][rows] = spread.raw[rows] ** 2 - 1.0, spread.white[rows] ** 2 - 1.0
            for window, variance in spread.means.items():
                of_means[number].setdefault(window, np.zeros(len(record)))[rows] = variance[rows]
    _check_there(np.concatenate(white), spec.output)
    noise = float(np.nanmean(np.square(np.concatenate(residuals))))
    raw_factor, _ = _factor(np.concatenate(raw), np.concatenate(of_raw) / whole.variance, noise)
    white_factor, scale = _factor(np.concatenate(white), np.concatenate(of_white) / whitener.deviation**2, 1.0)
    deviation = whitener.deviation * scale
    doubt = Doubt(root=whole.root, raw=raw_factor / whole.variance, white=white_factor / whitener.deviation**2)
    seen = [
        (
            e,
            w / scale,
            Spread(
                raw=np.sqrt(1.0 + doubt.raw * h),
                white=np.sqrt(1.0 + doubt.white * g),
                means={window: doubt.white * variance for window, variance in means.items()},
            ),
        )
        for e, w, h, g, means in zip(raw, white, of_raw, of_white, of_means, strict=True)
    ]
    operator = replace(whole.operator, rms_residual=frozen([np.sqrt(noise)]))
    return _Learnt(operator=operator, whitener=replace(whitener, deviation=deviation), doubt=doubt, seen=seen)


def _folds(records: Sequence[Record]) -> Iterator[tuple[list[Record], list[Rows]]]:
    """Yield what to identify on, and which rows of which records that leaves to be judged."""
    pieces: list[Rows] = []
    for number, record in enumerate(records):
        edges = np.linspace(0, len(record), (1 if len(records) > 2 else _FOLDS) + 1).astype(int).tolist()
        pieces += [(number, slice(first, stop)) for first, stop in pairwise(edges)]
    for first in range(min(len(pieces), _MOST_FOLDS)):
        held = pieces[first::_MOST_FOLDS]
        yield [_part(records[number], rows) for number, rows in pieces if (number, rows) not in held], held


def _check_length(bank: Bank, total_s: float) -> None:
    """Refuse to identify operators that look over much of what there is: they would fit it, and nothing else."""
    for spec in bank.residuals:
        least_s = _LOOKS * (spec.look_back_s + spec.look_ahead_s)
        if total_s < least_s:
            raise InputError(
                f"{total_s:.3g} s of healthy records are too few for the residual of {spec.output}, which looks over "
                f"{spec.look_back_s + spec.look_ahead_s:g} s; give at least {least_s:g} s, or look back and ahead less"
            )


def _part(record: Record, rows: slice) -> Record:
    return record.between(record.time_s[rows.start], record.time_s[rows.stop - 1])


def _check_there(white: FloatArray, output: str) -> None:
    """Refuse residuals that are mostly missing: thresholds wouldn't stand on anything."""
    share = float(np.isfinite(white).mean())
    if share < _LEAST_THERE:
        raise InputError(
            f"{100.0 * (1.0 - share):.0f} % of the residual of {output} is missing, for every missing sample takes "
            "those around it along; choose another stretch, or resample the log to its slowest channel"
        )


def _factor(values: FloatArray, share: FloatArray, least: float) -> tuple[float, float]:
    """Return k and s that make values of deviation s sqrt(1 + k share) likeliest (Gaussian, k >= 1, s^2 >= least).

    Without the least, where the share hardly varies, noise could pass for the model's error.
    """
    there = np.isfinite(values)
    squares = np.square(values[there])
    scale = float(np.median(squares)) / 0.455  # of a normal's square
    squares = np.minimum(squares, _MOST**2 * max(scale, least))
    best = (np.inf, 1.0, 1.0)
    for factor in _FACTORS.tolist():
        power = 1.0 + factor * share[there]
        level = max(float(np.mean(squares / power)), least)
        cost = float(np.sum(np.log(level * power) + squares / (level * power)))
        best = min(best, (cost, factor, np.sqrt(level)))
    return best[1], float(best[2])
