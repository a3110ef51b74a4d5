"""Identification of a bank's residuals: healthy records in, an operator out, by any estimator."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gtmbench.detectors.bank.bank import ResidualSpec
from gtmbench.errors import InputError
from gtmbench.method.estimators.bayesian import Bayesian
from gtmbench.method.identify import identify, operator_of
from gtmbench.method.problem import Estimator, Problem
from gtmbench.method.pseudo_inputs import derive
from gtmbench.method.regression.equations import interpolated
from gtmbench.method.regression.stretches import Scaling, Stretch, check_constant
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.values.record import FloatArray, Record

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
