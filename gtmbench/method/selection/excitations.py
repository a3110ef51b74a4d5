"""How many independent excitations act on the system: section 4.3, last paragraph."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.checks import names, number
from gtmbench.errors import InputError
from gtmbench.method.problem import Constant, Records, Weights, pose_problem
from gtmbench.method.regression.triangle import without
from gtmbench.values.record import FloatArray

if TYPE_CHECKING:
    import pandas as pd

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
