"""Calibration: healthy records in, a monitor out - operators, whitening filters, thresholds for a false-alarm rate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gtmbench.checks import number
from gtmbench.detectors.bank.bank import Bank, ResidualSpec
from gtmbench.detectors.bank.calibrated import CalibratedBank, residuals_of
from gtmbench.detectors.bank.identification import identified
from gtmbench.detectors.bank.plan import Plan, divided, left_out
from gtmbench.detectors.statistics.spread import Spread
from gtmbench.detectors.statistics.statistic import Tolerance, tolerance_of
from gtmbench.detectors.statistics.tails import rate_bound
from gtmbench.detectors.statistics.thresholds import Residual, thresholds_of
from gtmbench.detectors.statistics.uncertainty import ParameterUncertainty
from gtmbench.detectors.statistics.whitening import Whitener, fit_whitener
from gtmbench.errors import InputError
from gtmbench.method.estimators.bayesian import Bayesian
from gtmbench.method.estimators.least_squares import LeastSquares
from gtmbench.method.problem import Estimator
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.progress import Progress, silent
from gtmbench.record import FloatArray, Record, frozen

_LITTLE_S = 300.0  # of healthy flight: with less, every sample counts
_MOST = 20.0  # deviations that one sample may count for
_FACTORS = np.concatenate([[1.0], np.geomspace(1.2, 300.0, 40)])
_LEAST_THERE = 0.5  # of the residual


def calibrate_bank(
    records: Sequence[Record],
    bank: Bank,
    *,
    false_alarms_per_hour: float,
    estimator: Estimator | None = None,
    provenance: Mapping[str, Any] | None = None,
    progress: Progress = silent,
) -> CalibratedBank:
    """Identify a bank on healthy records and set its thresholds on stretches that identification hadn't seen.

    Least squares take much flight: of several records every third identifies and the rest set thresholds; one record is
    cut in two (the first 40 % identify). A Bayesian estimator takes little: every stretch sets thresholds by operators
    that stand on the others, the monitor's own stand on all of them, and what the records leave open is carried along
    as their parameter uncertainty, so that another manoeuvre doesn't alarm for being another (`left_out` says what else
    is allowed for). The rate asked for is shared evenly by all series of all residuals.

    Parameters
    ----------
    records : sequence of Record
        Healthy measurements with the bank's channels, all of one sample period.
    bank : Bank
    false_alarms_per_hour : float
        Wanted of the whole monitor; far below 1 over the hours given, it stands on extrapolated tails.
    estimator : Estimator, optional
        `LeastSquares` for five minutes in all and more, `Bayesian` for less, unless told.
    provenance : mapping, optional
        Kept with the monitor: where the records come from.
    progress : callable
        Told the step, how many are done, and of how many.

    Raises
    ------
    InputError
        Where channels are missing or constant, or the records too short.
    """
    rate = number("false_alarms_per_hour", false_alarms_per_hour, 1e-9, 1e3)
    for record in records:
        bank.check_channels(record.channels)
    found = tuple(
        record.select(bank.channels) for record in records
    )  # what else is there may have a pseudo input's name
    period_s = found[0].sample_period_s
    if estimator is None:
        estimator = Bayesian() if sum(map(len, found)) * period_s < _LITTLE_S else LeastSquares()
    plan = left_out(found, bank) if isinstance(estimator, Bayesian) else divided(found, bank)
    bank, learnt, total = plan.bank, {}, len(bank.residuals) + 1
    for done, spec in enumerate(bank.residuals):
        progress(f"identify {spec.output}", done, total)
        learnt[spec.output] = _learn(plan, spec, estimator)
    progress("thresholds", total - 1, total)
    seen = {output: one.seen for output, one in learnt.items()}
    tolerances = {output: _tolerance(plan, residuals, period_s) for output, residuals in seen.items()}
    thresholds, block_s = thresholds_of(bank.statistic, seen, tolerances, period_s, rate)
    hours = sum(map(len, plan.judged)) * period_s / 3600.0
    progress("done", total, total)
    return CalibratedBank(
        bank=bank,
        operators={output: one.operator for output, one in learnt.items()},
        whiteners={output: one.whitener for output, one in learnt.items()},
        tolerances=tolerances,
        thresholds={
            output: {label: plan.margin * threshold for label, threshold in own.items()}
            for output, own in thresholds.items()
        },
        uncertainties={output: one.uncertainty for output, one in learnt.items() if one.uncertainty is not None},
        sample_period_s=period_s,
        provenance={
            **(provenance or {}),
            "records": len(found),
            "identification_hours": sum(map(len, plan.learn)) * period_s / 3600.0,
            "threshold_hours": hours,
            "block_s": block_s,
            "false_alarms_per_hour": rate,
            "false_alarms_per_hour_at_most": rate_bound(0, hours),
        },
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Learnt:
    """One residual; `seen`: raw, whitened and their spread, by operators that hadn't seen them, one a record."""

    operator: Transmissibility
    whitener: Whitener
    uncertainty: ParameterUncertainty | None = None
    seen: Sequence[Residual] = field(repr=False)


def _learn(plan: Plan, spec: ResidualSpec, estimator: Estimator) -> _Learnt:
    operator, scale = identified(plan.learn, spec, estimator)
    residuals = [_residual(plan.bank, record, operator) for record in plan.learn]
    whitener = fit_whitener(residuals, order=plan.order)
    uncertain = isinstance(estimator, Bayesian)
    parts: list[list[Residual]] = [[] for _ in plan.judged]
    for records, held in plan.folds:
        part = operator if records is plan.learn else identified(records, spec, estimator, scale=scale)[0]
        for i, rows in held:
            parts[i].append(_judged(plan.bank, plan.judged[i], rows, part, whitener, uncertain=uncertain))
    learnt = _Learnt(operator=operator, whitener=whitener, seen=[_joined(pieces) for pieces in parts])
    return _weighed(learnt, float(np.nanmean(np.square(np.concatenate(residuals))))) if uncertain else learnt


def _residual(bank: Bank, record: Record, operator: Transmissibility) -> FloatArray:
    (output,) = operator.outputs
    return residuals_of(bank, record, {output: operator}, [output]).raw[output]


def _judged(
    bank: Bank, record: Record, rows: slice, operator: Transmissibility, whitener: Whitener, *, uncertain: bool
) -> Residual:
    """Return some rows of a record's residual and, of an uncertain operator, |F' phi(k)|^2 as their spread."""
    residual = _residual(bank, record, operator)
    raw, white = residual[rows], whitener.whiten(residual)[rows]
    if not uncertain:
        return raw, white, None
    alone = ParameterUncertainty(root=operator.covariance_root(*operator.outputs), raw=1.0, white=1.0)
    return raw, white, alone.spread(operator, record, whitener.coefficients, bank.statistic).between(rows)


def _joined(parts: Sequence[Residual]) -> Residual:
    """Return the pieces of one record as one, in their order."""
    spreads = [spread for _, _, spread in parts if spread is not None]
    raw, white = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    return raw, white, Spread.joined(spreads) if spreads else None


def _weighed(learnt: _Learnt, noise: float) -> _Learnt:
    """Return what was learnt with the parameters' uncertainty weighed against the noise, by what was judged.

    The residual and its noise are slow motion in the one and all of it in the other; equations are more alike or less
    than the estimator takes them to be: so two factors on the covariance are found, of the residual as it is and
    whitened, and how much stronger the noise is where identification hadn't seen it.

    Parameters
    ----------
    learnt : _Learnt
        With |F' phi(k)|^2 as spread, of a covariance F F'.
    noise : float
        The residual's mean square on the records that were identified on.
    """
    operator, whitener = learnt.operator, learnt.whitener
    seen = [(raw, white, alone) for raw, white, alone in learnt.seen if alone is not None]
    raw, white = (np.concatenate([one[i] for one in seen]) for i in (0, 1))
    spread = Spread.joined([alone for *_, alone in seen])
    _check_there(white, *operator.outputs)
    variance = float(np.asarray(operator.noise_variance)[0])
    raw_factor, _ = _factor(raw, (spread.raw**2 - 1.0) / variance, noise)
    white_factor, scale = _factor(white, (spread.white**2 - 1.0) / whitener.deviation**2, 1.0)
    uncertainty = ParameterUncertainty(
        root=frozen(operator.covariance_root(*operator.outputs)),
        raw=raw_factor / variance,
        white=white_factor / whitener.deviation**2,
    )
    return _Learnt(
        operator=replace(operator, rms_residual=frozen([np.sqrt(noise)])),
        whitener=replace(whitener, deviation=whitener.deviation * scale),
        uncertainty=uncertainty,
        seen=[(raw, white / scale, uncertainty.weighed(alone)) for raw, white, alone in seen],
    )


def _tolerance(plan: Plan, seen: Sequence[Residual], sample_period_s: float) -> Tolerance:
    whites = [white if spread is None else white / spread.white for _, white, spread in seen]
    found = tolerance_of(whites, plan.bank.statistic, sample_period_s, noise=plan.deviations)
    return replace(found, high=max(found.high, plan.power))


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
