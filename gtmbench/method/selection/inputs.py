"""Choosing pseudo inputs greedily, one more at a time, from one triangle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.checks import whole
from gtmbench.method.estimators.problem import Problem
from gtmbench.method.pose import Records, as_records, operator_names, pose
from gtmbench.method.regression.triangle import Triangle, without
from gtmbench.method.selection.criteria import information
from gtmbench.record import FloatArray

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, kw_only=True, eq=False)
class InputChoice:
    """Chosen pseudo inputs, and what they were chosen from.

    Attributes
    ----------
    inputs : tuple of str
        In the order of choice; none where no candidate helps.
    reason : str
        Why, with the figures.
    table : DataFrame
        One row a step, those that weren't taken too: step, input (the one that is added), for every output
        ``rms_OUTPUT`` in its unit, gain (the factor by which the residual falls, geometric mean over the outputs), bic.
    """

    inputs: tuple[str, ...]
    reason: str
    table: pd.DataFrame = field(repr=False)


def select_inputs(
    records: Records,
    *,
    candidates: Sequence[str],
    outputs: Sequence[str],
    causal_order: int,
    noncausal_order: int,
    most: int | None = None,
) -> InputChoice:
    """Add the candidate that lowers the residual most, again and again, and keep the steps up to the least BIC.

    Every step is one block orthogonalisation: all lags of the candidate that was taken are projected out of the other
    candidates and of the outputs. Several outputs count by the product of their residuals, so units don't matter.

    Greedy: two inputs that help only together can be missed. BIC takes the residual as white; sensor noise on the
    inputs makes redundant sensors useful, for they average it, and then they are chosen, too: see `gain`.

    Parameters
    ----------
    records : Record or sequence of Record
        Healthy measurements.
    candidates, outputs : sequence of str
        Channels to choose from, and pseudo outputs.
    causal_order, noncausal_order : int
        r and d.
    most : int, optional
        How many inputs at most; all candidates unless told.

    Raises
    ------
    InputError
        Where channels are missing or the records are too short for all candidates.

    Examples
    --------
    >>> from gtmbench.record import Record
    >>> rng = np.random.default_rng(1)
    >>> values = rng.standard_normal((1000, 4))
    >>> values[:, 3] = values[:, 0] - 2.0 * np.roll(values[:, 2], 1) + 0.1 * values[:, 3]
    >>> record = Record(values, channels=["a", "b", "c", "y"], sample_period_s=0.01)
    >>> select_inputs(record, candidates=["a", "b", "c"], outputs=["y"], causal_order=2, noncausal_order=2).inputs
    ('c', 'a')
    """
    u, y = operator_names(candidates, outputs)
    steps = len(u) if most is None else min(whole("most", most, 1), len(u))
    problem = pose(as_records(records), u, y, causal_order, noncausal_order)
    return _choice(problem, problem.triangle(), steps)


def _choice(problem: Problem, equations: Triangle, steps: int) -> InputChoice:
    import pandas as pd

    n, lags, scale = equations.equations, problem.lags, problem.scale[len(problem.inputs) :]
    nil = equations.tolerance**2 * n
    blocks = equations.root[:, : equations.size].reshape(len(equations.root), lags, -1)
    left = dict(zip(problem.inputs, blocks.transpose(2, 0, 1), strict=True))
    targets = equations.target
    squares = np.sum(targets**2, axis=0)
    bics = [information(squares, n, 0)[1]]
    rows = []
    for step in range(1, steps + 1):
        trials = {name: without(np.hstack([block, targets]), lags, equations.floor) for name, block in left.items()}
        best = min(trials, key=lambda name: _size(trials[name], nil))
        rest = without(np.hstack([left.pop(best), *left.values(), targets]), lags, equations.floor)
        left = {name: rest[:, i * lags : (i + 1) * lags] for i, name in enumerate(left)}
        targets = rest[:, len(left) * lags :]
        before, squares = squares, np.maximum(np.sum(targets**2, axis=0), nil)
        bics.append(information(squares, n, step * lags)[1])
        rows.append(
            {
                "step": step,
                "input": best,
                **{f"rms_{o}": rms for o, rms in zip(problem.outputs, np.sqrt(squares / n) * scale, strict=True)},
                "gain": float(np.exp(np.mean(np.log(before / squares)) / 2.0)),
                "bic": bics[-1],
            }
        )
    kept = int(np.argmin(bics))
    inputs = tuple(str(row["input"]) for row in rows[:kept])
    return InputChoice(inputs=inputs, reason=_reason(inputs, bics, problem), table=pd.DataFrame(rows))


def _size(left: FloatArray, nil: float) -> float:
    """Return the logarithm of the product of the residuals' squares."""
    return float(np.sum(np.log(np.maximum(np.sum(left**2, axis=0), nil))))


def _reason(inputs: tuple[str, ...], bics: Sequence[float], problem: Problem) -> str:
    taken, tried = len(inputs), len(bics) - 1
    if not taken:
        return f"no candidate lowers the BIC: none of {', '.join(problem.inputs)} predicts {', '.join(problem.outputs)}"
    path = ", ".join(f"{bic:.6g}" for bic in bics)
    if taken == len(problem.inputs):
        return f"{', '.join(inputs)}: every candidate lowers the BIC ({path})"
    if taken == tried:
        return f"{', '.join(inputs)}: the BIC still falls with input {taken}, the most that were allowed ({path})"
    return f"{', '.join(inputs)}: the least BIC of the steps 0..{tried} is that of step {taken} ({path})"
