"""Calibration: healthy records in, a monitor out - operators, whitening filters, thresholds for a false-alarm rate.

A plan says which stretches identify and which are judged. Of much flight some identifies and the rest is judged. Of
little every sample counts: each stretch is judged by operators that haven't seen it, and the monitor's own stand on all
of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from gtmbench.checks import number
from gtmbench.detectors.bank.bank import Bank, ResidualSpec
from gtmbench.detectors.bank.calibrated import CalibratedBank, residuals_of
from gtmbench.detectors.excursion import Turning
from gtmbench.detectors.statistics.learnt_noise import followed
from gtmbench.detectors.statistics.statistic import Allowance, Spread, tolerance_of
from gtmbench.detectors.statistics.thresholds import Residual, healthy_maxima, rate_bound
from gtmbench.detectors.statistics.uncertainty import HALF, ParameterUncertainty
from gtmbench.detectors.statistics.whitening import White, Whitener, fit_whitener
from gtmbench.errors import InputError
from gtmbench.jobs.progress import Progress, silent
from gtmbench.jobs.threads import on_one_thread
from gtmbench.method.estimators.bayesian import Bayesian
from gtmbench.method.estimators.least_squares import LeastSquares
from gtmbench.method.identify import identify, operator_of
from gtmbench.method.problem import Estimator, Problem
from gtmbench.method.pseudo_inputs import derive
from gtmbench.method.regression.equations import interpolated
from gtmbench.method.regression.stretches import Scaling, Stretch, check_constant
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.values.record import FloatArray, Record, frozen

Scale = FloatArray  # RMS of inputs and output, in this order


def identified(
    records: Sequence[Record], spec: ResidualSpec, estimator: Estimator, *, scale: Scale | None = None
) -> tuple[Transmissibility, Scale | None]:
    """Identify the operator of one residual, and return it with the RMS values that a prior stands on.

    `records`: healthy, with the channels that the residual needs. `estimator`: `Bayesian` bridges gaps; others refuse
    them. `scale`, shape (inputs + 1,): of the flight that the records are a part of: in a part, a channel may be at
    rest. InputError where no complete window of samples is there, or a channel is constant.
    """
    period_s = records[0].sample_period_s
    causal, noncausal = round(spec.look_back_s / period_s), round(spec.look_ahead_s / period_s)
    channels = [*spec.inputs, spec.output]
    derived = [derive(record, channels).select(channels) for record in records]
    if isinstance(estimator, Bayesian):
        problem = _posed(derived, spec, causal, noncausal, scale)
        return operator_of(problem, estimator.estimate(problem), estimator), problem.scale
    operator = identify(
        [_complete(record) for record in derived],
        inputs=spec.inputs,
        outputs=[spec.output],
        causal_order=causal,
        noncausal_order=noncausal,
        estimator=estimator,
    )
    return operator, None


def _posed(
    records: Sequence[Record], spec: ResidualSpec, causal_order: int, noncausal_order: int, scale: Scale | None
) -> Problem:
    """Pose records whose missing samples are bridged and have weight 0: slow motion goes on across a gap."""
    there = [np.isfinite(record.values).all(axis=1) for record in records]
    rows = np.concatenate([record.values[some] for record, some in zip(records, there, strict=True)])
    centre = rows.mean(axis=0) if len(rows) else np.zeros(rows.shape[1])
    if scale is None:
        scale = rows.std(axis=0) if len(rows) else np.ones(rows.shape[1])
        check_constant(records[0].channels, centre, scale)
    scaling = Scaling(rows=np.arange(len(centre)), centre=centre, rms=scale)
    return Problem(
        stretches=tuple(
            Stretch(values=interpolated(record.values).T, weights=np.asarray(some, dtype=np.float64), scaling=scaling)
            for record, some in zip(records, there, strict=True)
        ),
        instruments=(),
        inputs=spec.inputs,
        outputs=(spec.output,),
        causal_order=causal_order,
        noncausal_order=noncausal_order,
        centre=centre,
        scale=scale,
        sample_period_s=records[0].sample_period_s,
    )


def _complete(record: Record) -> Record:
    """Return a record without the missing rows at its ends: derivatives don't reach there."""
    there = np.flatnonzero(np.isfinite(record.values).all(axis=1))
    if len(there) == 0:
        raise InputError("a record is too short for the bank's look-back and look-ahead; give a longer one")
    return record.between(record.time_s[there[0]], record.time_s[there[-1]])


_LITTLE_S = 300.0  # of healthy flight: with less, every sample counts
_MOST = 20.0  # deviations that one sample may count for
_FACTORS = np.concatenate([[1.0], np.geomspace(1.2, 300.0, 40)])  # on an operator's error, tried in steps of 15 %
_KNOWN = 0.01  # the sum of the parameters' variances: what they let pass of an input's noise
_LEAST_THERE = 0.5  # of the residual
_FIRST = 0.4  # of one record: identifies
_SHORTEST = 20  # samples
_FOLDS = 5  # stretches of one or two records; of more, each record is one
_MOST_FOLDS = 10  # each identifies a bank anew: time grows with them
_BASELINES = 5.0  # in the shortest record
_SHORTEST_S = 5.0  # of a healthy record: less is refused
_LOOKS = 20.0  # so many times what an operator looks back and ahead, at least
_A_COEFFICIENT = 50  # samples that one of a whitening filter stands on

Rows = tuple[int, slice]  # of a judged record, by its number
Fold = tuple[Sequence[Record], Sequence[Rows]]  # to identify on, and what these operators judge


@on_one_thread
def calibrate_bank(
    records: Sequence[Record],
    bank: Bank,
    *,
    false_alarms_per_hour: float,
    estimator: Estimator | None = None,
    provenance: Mapping[str, object] | None = None,
    progress: Progress = silent,
) -> CalibratedBank:
    """Identify a bank on healthy records and set its thresholds on stretches that identification hadn't seen.

    Of much flight every third record identifies and the rest set thresholds; one record is cut in two (the first 40 %
    identify), by least squares unless told; residuals that physics fixes are always identified by `Bayesian`, unless
    told. Of little flight, or where a Bayesian estimator is asked for, every stretch sets thresholds by operators that
    stand on the others, the monitor's own stand on all of them, and what the records leave open is carried along as
    their parameter uncertainty, so that another manoeuvre doesn't alarm for being another (`_left_out` says what else
    is allowed for). The rate asked for is shared evenly by all scores of all residuals. Parameters and errors are those
    of `bank_detector.calibrate`.
    """
    rate = number("false_alarms_per_hour", false_alarms_per_hour, 1e-9, 1e3)
    for record in records:
        bank.check_channels(record.channels)
    # what else is there may have a pseudo input's name
    healthy = tuple(record.select(bank.channels) for record in records)
    period_s = healthy[0].sample_period_s
    is_little = sum(map(len, healthy)) * period_s < _LITTLE_S if estimator is None else isinstance(estimator, Bayesian)
    # who learns from what, and who is judged on what it hasn't seen
    plan = _left_out(healthy, bank) if is_little else _divided(healthy, bank)
    bank, learnt, total = plan.bank, {}, len(bank.residuals) + 1
    for done, spec in enumerate(bank.residuals):
        progress(f"identify {spec.output}", done, total)
        usual = Bayesian() if is_little or spec.is_fixed_by_physics else LeastSquares()
        learnt[spec.output] = _learn(plan, spec, estimator or usual, uncertain=is_little)
    progress("thresholds", total - 1, total)
    # thresholds: of residuals that identification hadn't seen, for the rate asked for (`thresholds`)
    judged = {output: each.judged for output, each in learnt.items()}
    tolerances = {output: _tolerance(plan, residuals, period_s) for output, residuals in judged.items()}
    seen = healthy_maxima(bank.statistic, judged, tolerances, period_s)
    hours = sum(map(len, plan.judged)) * period_s / 3600.0
    progress("done", total, total)
    turning = Turning.of(healthy).table
    return CalibratedBank(
        bank=bank,
        operators={output: each.operator for output, each in learnt.items()},
        whiteners={output: each.whitener for output, each in learnt.items()},
        tolerances=tolerances,
        thresholds=seen.thresholds(rate),
        uncertainties={output: each.uncertainty for output, each in learnt.items() if each.uncertainty is not None},
        sample_period_s=period_s,
        provenance={
            **(provenance or {}),
            "records": len(healthy),
            "identification_hours": sum(map(len, plan.learn)) * period_s / 3600.0,
            "threshold_hours": hours,
            "block_s": seen.block_s,
            "threshold_spread": seen.luck(rate).table(),
            "false_alarms_per_hour": rate,
            "false_alarms_per_hour_at_most": rate_bound(0, hours),
            **({"turning": turning} if turning else {}),
        },
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Learnt:
    """One residual; `judged`: raw, whitened and their spread, by operators that hadn't seen them, one a record."""

    operator: Transmissibility
    whitener: Whitener
    uncertainty: ParameterUncertainty | None = None
    judged: Sequence[Residual] = field(repr=False)


def _learn(plan: Plan, spec: ResidualSpec, estimator: Estimator, *, uncertain: bool) -> _Learnt:
    operator, scale = identified(plan.learn, spec, estimator)
    residuals = [_residual(plan.bank, record, operator) for record in plan.learn]
    whitener = fit_whitener(residuals, order=plan.order)
    half = _half(operator) if uncertain else None
    parts: list[list[Residual]] = [[] for _ in plan.judged]
    for records, held in plan.folds:
        part = operator if records is plan.learn else identified(records, spec, estimator, scale=scale)[0]
        for i, rows in held:
            parts[i].append(_judged(plan.bank, plan.judged[i], rows, part, whitener, half))
    learnt = _Learnt(operator=operator, whitener=whitener, judged=[_joined(pieces) for pieces in parts])
    if half is not None:
        learnt = _weighed(learnt, float(np.nanmean(np.square(np.concatenate(residuals)))), half)
    if plan.bank.statistic.name == "energy":
        return learnt
    return replace(learnt, judged=[_followed(learnt.whitener, residual, plan) for residual in learnt.judged])


def _followed(whitener: Whitener, residual: Residual, plan: Plan) -> Residual:
    """Return a residual whitened as it will be where it is watched: by the noise that is learnt there."""
    raw, _, spread = residual
    period_s = plan.learn[0].sample_period_s
    return raw, followed(whitener, raw, period_s, None if spread is None else spread.white), spread


def _half(operator: Transmissibility) -> int:
    """Return from how many samples to either side motion has to be told from noise before it widens a residual.

    From none where the parameters are known so well that noise widens nothing: what isn't looked at needn't be awaited.
    """
    (output,) = operator.outputs
    return 0 if np.sum(operator.covariance_root(output) ** 2) < _KNOWN else HALF


def _residual(bank: Bank, record: Record, operator: Transmissibility) -> FloatArray:
    (output,) = operator.outputs
    return residuals_of(bank, record, {output: operator}, [output]).raw[output]


def _judged(
    bank: Bank, record: Record, rows: slice, operator: Transmissibility, whitener: Whitener, half: int | None
) -> Residual:
    """Return some rows of a record's residual and, of an uncertain operator, |F' phi(k)|^2 as their spread."""
    residual = _residual(bank, record, operator)
    raw, white = residual[rows], White.steady(whitener.whiten(residual)[rows])
    if half is None:
        return raw, white, None
    alone = ParameterUncertainty(root=operator.covariance_root(*operator.outputs), raw=1.0, white=1.0, half=half)
    return raw, white, alone.spread(operator, record, whitener.coefficients, bank.statistic, rows).between(rows)


def _joined(parts: Sequence[Residual]) -> Residual:
    """Return the pieces of one record as one, in their order."""
    spreads = [spread for _, _, spread in parts if spread is not None]
    raw, white = np.concatenate([part[0] for part in parts]), White.joined([part[1] for part in parts])
    return raw, white, Spread.joined(spreads) if spreads else None


def _weighed(learnt: _Learnt, noise: float, half: int) -> _Learnt:
    """Return what was learnt with the parameters' uncertainty weighed against the noise, by what was judged.

    The residual and its noise are slow motion in the one and all of it in the other; equations are more alike or less
    than the estimator takes them to be: so two factors on the covariance are found, of the residual as it is and
    whitened, and how much stronger the noise is where identification hadn't seen it.

    `learnt`: with |F' phi(k)|^2 as spread, of a covariance F F'. `noise`: the residual's mean square on the records
    that were identified on. `half`: of the uncertainty.
    """
    operator, whitener = learnt.operator, learnt.whitener
    judged = [(raw, white, alone) for raw, white, alone in learnt.judged if alone is not None]
    raw = np.concatenate([residual[0] for residual in judged])
    white = np.concatenate([residual[1].values for residual in judged])
    spread = Spread.joined([alone for *_, alone in judged])
    _check_there(white, *operator.outputs)
    variance = float(np.asarray(operator.noise_variance)[0])
    raw_factor, _ = _factor(raw, (spread.raw**2 - 1.0) / variance, noise)
    white_factor, scale = _factor(white, (spread.white**2 - 1.0) / whitener.deviation**2, 1.0)
    uncertainty = ParameterUncertainty(
        root=frozen(operator.covariance_root(*operator.outputs)),
        raw=raw_factor / variance,
        white=white_factor / whitener.deviation**2,
        half=half,
    )
    return _Learnt(
        operator=replace(operator, rms_residual=frozen([np.sqrt(noise)])),
        whitener=replace(whitener, deviation=whitener.deviation * scale),
        uncertainty=uncertainty,
        judged=[(raw, white, uncertainty.weighed(alone)) for raw, white, alone in judged],
    )


def _tolerance(plan: Plan, judged: Sequence[Residual], sample_period_s: float) -> Allowance:
    whites = [white.values if spread is None else white.values / spread.white for _, white, spread in judged]
    return tolerance_of(whites, plan.bank.statistic, sample_period_s)


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
        variance = max(float(np.mean(squares / power)), least)
        cost = float(np.sum(np.log(variance * power) + squares / (variance * power)))
        best = min(best, (cost, factor, np.sqrt(variance)))
    return best[1], float(best[2])


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """Which healthy stretches identify, which are judged, and what is allowed for beyond them."""

    bank: Bank  # with the statistic that its thresholds are set for
    learn: Sequence[Record] = field(repr=False)  # that the monitor's operators and whitening filters stand on
    judged: Sequence[Record] = field(repr=False)  # that its thresholds stand on
    # which operators judge which rows; those of `learn` itself are the monitor's own
    folds: Sequence[Fold] = field(repr=False)
    order: int  # of the whitening filters


def _divided(records: Sequence[Record], bank: Bank) -> Plan:
    """Return a plan for much flight."""
    learn, judged = divided(records)
    everything = [(i, slice(len(record))) for i, record in enumerate(judged)]
    order = round(bank.whitening_s / records[0].sample_period_s)
    return Plan(bank=bank, learn=learn, judged=judged, folds=[(learn, everything)], order=order)


def divided(records: Sequence[Record]) -> tuple[list[Record], list[Record]]:
    """Return every third record, to identify on, and the others, to judge; of one record, 40 % and the rest."""
    if len(records) > 1:
        return list(records[::3]), [record for i, record in enumerate(records) if i % 3]
    (only,) = records
    if len(only) < _SHORTEST:
        raise InputError(f"a record of {len(only)} samples is too short to calibrate on; give minutes")
    cut_s = only.start_s + _FIRST * (only.end_s - only.start_s)
    return [only.between(only.start_s, cut_s)], [only.between(cut_s, only.end_s)]


def check_long(records: Sequence[Record]) -> float:
    """Return how long the shortest of healthy records is; refuse one that is too short."""
    shortest_s = min(map(len, records)) * records[0].sample_period_s
    if shortest_s < _SHORTEST_S:
        raise InputError(
            f"a healthy record of {shortest_s:.3g} s is too short to calibrate on; give at least {_SHORTEST_S:g} s, "
            "better minutes"
        )
    return shortest_s


def _left_out(records: Sequence[Record], bank: Bank) -> Plan:
    """Return a plan for little flight: every stretch is left out in turn.

    Too little energy doesn't alarm, and means are compared with those of the last fifth of a record.

    InputError where the records are too short.
    """
    period_s, samples = records[0].sample_period_s, sum(map(len, records))
    shortest_s = check_long(records)
    _check_length(bank, samples * period_s)
    baseline_s = min(bank.statistic.baseline_s, shortest_s / _BASELINES)
    return Plan(
        bank=replace(bank, statistic=replace(bank.statistic, baseline_s=baseline_s, two_sided=False)),
        learn=records,
        judged=records,
        folds=list(_folds(records)),
        order=min(round(bank.whitening_s / period_s), samples // _A_COEFFICIENT),
    )


def _folds(records: Sequence[Record]) -> Iterator[Fold]:
    pieces: list[Rows] = []
    for i, record in enumerate(records):
        edges = np.linspace(0, len(record), (1 if len(records) > 2 else _FOLDS) + 1).astype(int).tolist()
        pieces += [(i, slice(first, stop)) for first, stop in pairwise(edges)]
    for first in range(min(len(pieces), _MOST_FOLDS)):
        held = pieces[first::_MOST_FOLDS]
        yield [_part(records[i], rows) for i, rows in pieces if (i, rows) not in held], held


def _part(record: Record, rows: slice) -> Record:
    return record.between(record.time_s[rows.start], record.time_s[rows.stop - 1])


def _check_length(bank: Bank, total_s: float) -> None:
    """Refuse to identify operators that look over much of what there is: they would fit it, and nothing else."""
    for spec in bank.residuals:
        least_s = _LOOKS * (spec.look_back_s + spec.look_ahead_s)
        if total_s < least_s:
            raise InputError(
                f"{total_s:.3g} s of healthy records are too few for the residual of {spec.output}, which looks over "
                f"{spec.look_back_s + spec.look_ahead_s:g} s; give at least {least_s:g} s, or look back and ahead less"
            )
