"""Choosing pseudo inputs, and counting the independent excitations that they follow: greedily, from one triangle."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.checks import names, number, whole
from gtmbench.errors import InputError
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


_MOST_CHANNELS = 10  # 1022 choices of inputs
_SHARE = 0.6  # of the sharpest drop, on a logarithmic axis: what a drop needs to be one


@dataclass(frozen=True, kw_only=True, eq=False)
class ExcitationCount:
    """The number of independent excitations, and the evidence.

    Attributes
    ----------
    excitations : int or None
        m; None if these channels don't bound it: then it is at least their number less 1.
    reason : str
        Why, with the figures.
    by_m : Series
        Over m = 1..p-1: the RMS over the outputs of the relative residuals, for the best choice of m inputs.
    table : DataFrame
        One row for every choice of inputs and every output: m, inputs (a tuple), output, and relative_residual, the
        residual's RMS over the output's.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> rng = np.random.default_rng(1)
    >>> values = rng.standard_normal((1000, 1)) @ [[1.0, 2.0, 3.0]] + 0.01 * rng.standard_normal((1000, 3))
    >>> record = gb.Record(values, channels=["a", "b", "c"], sample_period_s=0.01)
    >>> count = gb.count_excitations(record, channels=["a", "b", "c"], causal_order=1, noncausal_order=1)
    >>> count.excitations, count.by_m.index.tolist()
    (1, [1, 2])
    """

    excitations: int | None
    reason: str
    by_m: pd.Series[float] = field(repr=False)
    table: pd.DataFrame = field(repr=False)


def count_excitations(
    records: Records,
    *,
    channels: Sequence[str],
    causal_order: int,
    noncausal_order: int,
    gain: float = 1.5,
    weights: Weights = None,
    constant: Constant = "estimated",
) -> ExcitationCount:
    """Count independent excitations: the m beyond which predicting channels from m others gains little.

    All choices of m = 1..p-1 of p channels are tried. As many pseudo inputs as excitations predict the other sensors
    down to noise; fewer don't, and more only average noise. So the curve `by_m` (which begins at 1 for m = 0) drops
    until m is reached and is nearly flat from there on. m is the last sizable step: a drop by the factor `gain` or
    more, and on a logarithmic axis at least 0.6 times as long as the sharpest.

    Averaging alone stays below a `gain` of 1.5: for like sensors of one excitation, m inputs predict with a noise power
    of 1 + 1/m, so the second gains sqrt(2 / 1.5) = 1.15, and any number of them less than sqrt(2) = 1.41. Unlike
    sensors gain more: where a zero lies near the unit circle the inverse is long and amplifies noise, and one sensor
    more can give a factor of 7 at an SNR of 1000. Such a step is short beside the sharpest, hence the second condition.

    Parameters
    ----------
    records : Record or sequence of Record
        Healthy measurements.
    channels : sequence of str
        Two to ten sensors; better two more than excitations, for with m = p - 1 only one output is left, the easiest.
    causal_order, noncausal_order : int
        r and d: long enough for the filters between sensors.
    gain : float
        Greater than 1.
    weights : array_like, optional
    constant : str
        As for `identify`.

    Raises
    ------
    InputError
        If channels are missing, too many or too few, or the records are too short for p inputs.

    Notes
    -----
    Residual powers are divided by the equations less the parameters, so short records show no false drop.

    Only independent excitations at many frequencies are counted. Sinusoids at f frequencies make 2 f numbers a sample,
    which 2 f lags of *one* sensor hold: one input then suffices, however many surfaces move (and noise decides what is
    seen). The same holds without noise for a few lightly damped modes that ring freely (the plate of section 4.5).
    A sensor that is mostly noise counts as an excitation of its own. Where filters between sensors are much longer than
    r + d samples (slow modes at a high rate) the curve falls slowly and no count means much: look at `by_m`.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> rng = np.random.default_rng(1)
    >>> u, noise = rng.standard_normal((2000, 2)), 0.01 * rng.standard_normal((2000, 4))
    >>> values = u @ rng.standard_normal((2, 4)) + noise  # two excitations, four sensors
    >>> record = gb.Record(values, channels=["a", "b", "c", "d"], sample_period_s=0.01)
    >>> count = gb.count_excitations(record, channels=["a", "b", "c", "d"], causal_order=2, noncausal_order=2)
    >>> count.excitations
    2
    """
    wanted = names("channels", channels)
    number("gain", gain, 1.0, above=True)
    _check_channels(wanted)
    problem = pose_problem(records, wanted, (), causal_order, noncausal_order, weights=weights, constant=constant)
    equations = problem.triangle()
    count, lags = len(wanted), problem.lags
    blocks = equations.root.reshape(len(equations.root), lags, count)
    state = np.hstack([*blocks.transpose(2, 0, 1), blocks[:, problem.causal_order]])
    rows = []
    for chosen, left in _choices(state, lags, (), tuple(range(count)), count, equations.floor):
        free = equations.weight - len(chosen) * lags - problem.with_constant
        rows += [
            {
                "m": len(chosen),
                "inputs": tuple(wanted[i] for i in chosen),
                "output": wanted[o],
                "relative_residual": left[o] / np.sqrt(free),
            }
            for o in range(count)
            if o not in chosen
        ]
    return _count(rows, gain)


def _check_channels(channels: tuple[str, ...]) -> None:
    if len(channels) < 2:
        raise InputError(f"channels names {len(channels)}; it takes 2 to predict one another, better 4 or more")
    if len(channels) > _MOST_CHANNELS:
        raise InputError(
            f"{len(channels)} channels are {2 ** len(channels) - 2} choices of inputs; give at most {_MOST_CHANNELS}, "
            "those that differ most"
        )


def _choices(
    state: FloatArray, lags: int, chosen: tuple[int, ...], later: tuple[int, ...], count: int, floor: float
) -> Iterator[tuple[tuple[int, ...], FloatArray]]:
    """Yield every choice of fewer than all inputs with the lengths of what it leaves of each channel.

    `state` holds what `chosen` leaves of ``[lags of each later channel | lag 0 of every channel]``: a choice of one
    more is one more projection.
    """
    for i, channel in enumerate(later):
        rest = without(state[:, i * lags :], lags, floor)
        now = (*chosen, channel)
        yield now, np.linalg.norm(rest[:, -count:], axis=0)
        if len(now) < count - 1:
            yield from _choices(rest, lags, now, later[i + 1 :], count, floor)


def _count(rows: Sequence[dict[str, object]], gain: float) -> ExcitationCount:
    """Return the count from one row for every choice and output."""
    import pandas as pd

    table = pd.DataFrame(rows).sort_values("m", kind="stable", ignore_index=True)
    power = table.assign(power=table["relative_residual"] ** 2).groupby(["m", "inputs"])["power"].mean()
    by_m = np.sqrt(power.groupby("m").min()).rename("relative_residual")
    curve = np.concatenate([[1.0], by_m.to_numpy()])
    drops = curve[:-1] / curve[1:]
    needed = max(gain, float(drops.max()) ** _SHARE)
    sizable = np.flatnonzero(drops >= needed) + 1
    most = len(drops)
    count = int(sizable[-1]) if len(sizable) else None
    said = ", ".join(f"{value:.3g}" for value in by_m)
    if count is None:
        reason = f"no choice of inputs predicts the others (m = 1..{most} leave {said} of their RMS)"
    elif count == most:
        count, reason = None, f"at least {most}: the residual still drops with the last input (m = 1..{most}: {said})"
    else:
        reason = (
            f"{count}: the residual, {said} of the outputs' RMS for m = 1..{most}, drops by {drops[count - 1]:.3g} "
            f"with input {count} and by at most {drops[count:].max():.3g} with a later one; "
            f"{needed:.3g} is a sizable drop"
        )
    return ExcitationCount(excitations=count, reason=reason, by_m=by_m, table=table)
