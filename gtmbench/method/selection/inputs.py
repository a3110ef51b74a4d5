"""Choosing pseudo inputs greedily, one more at a time, from one triangle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.checks import whole
from gtmbench.method.problem import Constant, Problem, Records, Weights, operator_names, pose_problem
from gtmbench.method.regression.triangle import Triangle, without
from gtmbench.method.selection.orders import information
from gtmbench.values.record import FloatArray

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, kw_only=True, eq=False)
class InputChoice:
    """Chosen pseudo inputs, and the evidence.

    Attributes
    ----------
    inputs : tuple of str
        In the order of choice; empty if no candidate helps.
    reason : str
        Why, with the figures.
    table : DataFrame
        One row a step, including rejected ones: step, input (the one that is added), for every output ``rms_OUTPUT`` in
        its unit, gain (the factor by which the residual falls, geometric mean over the outputs), bic.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> u = np.random.default_rng(1).standard_normal((1000, 2))
    >>> record = gb.Record(np.column_stack([u, u[:, 0]]), channels=["a", "b", "y"], sample_period_s=0.01)
    >>> noisy = gb.Record(record.values + 0.01 * np.random.default_rng(2).standard_normal((1000, 3)),
    ...                   channels=record.channels, sample_period_s=0.01)
    >>> choice = gb.select_inputs(noisy, candidates=["a", "b"], outputs=["y"], causal_order=1, noncausal_order=1)
    >>> choice.inputs
    ('a',)
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
    weights: Weights = None,
    constant: Constant = "estimated",
) -> InputChoice:
    """Choose pseudo inputs greedily: add the candidate that lowers the residual most, up to the least BIC.

    Every step is one block orthogonalisation: all lags of the candidate that was taken are projected out of the other
    candidates and of the outputs. Several outputs count by the product of their residuals, so units don't matter.

    Because it is greedy, it can miss two inputs that help only together. BIC assumes a white residual. Redundant
    sensors average the inputs' noise, so they are chosen, too: see `gain`.

    Parameters
    ----------
    records : Record or sequence of Record
        Healthy measurements.
    candidates, outputs : sequence of str
        Channels to choose from, and pseudo outputs.
    causal_order, noncausal_order : int
        r and d.
    most : int, optional
        How many inputs at most (by default all candidates).
    weights : array_like, optional
    constant : str
        As for `identify`.

    Raises
    ------
    InputError
        If channels are missing or the records are too short for all candidates.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> rng = np.random.default_rng(1)
    >>> values = rng.standard_normal((1000, 4))
    >>> values[:, 3] = values[:, 0] - 2.0 * np.roll(values[:, 2], 1) + 0.1 * values[:, 3]
    >>> record = gb.Record(values, channels=["a", "b", "c", "y"], sample_period_s=0.01)
    >>> gb.select_inputs(record, candidates=["a", "b", "c"], outputs=["y"], causal_order=2, noncausal_order=2).inputs
    ('c', 'a')
    """
    u, y = operator_names(candidates, outputs)
    steps = len(u) if most is None else min(whole("most", most, 1), len(u))
    problem = pose_problem(records, u, y, causal_order, noncausal_order, weights=weights, constant=constant)
    return _choice(problem, problem.triangle(), steps)


def _choice(problem: Problem, equations: Triangle, steps: int) -> InputChoice:
    import pandas as pd

    added, power = _path(problem, equations, steps)
    lags, scale = problem.lags, problem.scale[len(problem.inputs) :]
    _, bic = information(power, equations.weight, np.arange(steps + 1) * lags)
    table = pd.DataFrame(
        {
            "step": np.arange(1, steps + 1),
            "input": added,
            **{f"rms_{name}": rms for name, rms in zip(problem.outputs, (np.sqrt(power[1:]) * scale).T, strict=True)},
            "gain": np.exp(-np.diff(np.log(power), axis=0).mean(axis=1) / 2.0),
            "bic": bic[1:],
        }
    )
    inputs = tuple(added[: int(np.argmin(bic))])
    return InputChoice(inputs=inputs, reason=_reason(inputs, bic.tolist(), problem), table=table)


def _path(problem: Problem, equations: Triangle, steps: int) -> tuple[list[str], FloatArray]:
    """Return the inputs as they are added, and what is left of the outputs' power before and after each."""
    lags, targets = problem.lags, equations.target
    blocks = equations.root[:, : equations.size].reshape(len(equations.root), lags, -1)
    left = dict(zip(problem.inputs, blocks.transpose(2, 0, 1), strict=True))

    def powers(rest: FloatArray) -> FloatArray:
        # below the tolerance is rounding: one such choice is as good as another
        return np.asarray(np.maximum(np.sum(rest**2, axis=0) / equations.weight, equations.tolerance**2))

    def after(name: str) -> float:
        rest = without(np.hstack([left[name], targets]), lags, equations.floor)
        return float(np.sum(np.log(powers(rest))))

    added, path = [], [powers(targets)]
    for _ in range(steps):
        added.append(min(left, key=after))
        rest = without(np.hstack([left.pop(added[-1]), *left.values(), targets]), lags, equations.floor)
        left = {name: rest[:, i * lags : (i + 1) * lags] for i, name in enumerate(left)}
        targets = rest[:, len(left) * lags :]
        path.append(powers(targets))
    return added, np.array(path)


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
