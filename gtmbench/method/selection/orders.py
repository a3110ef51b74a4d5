"""Choosing r and d: nested models are blocks of one triangle, so a whole surface costs about its largest member.

Columns of the triangle run from lag r to -d. A smaller d takes fewer leading columns: what they leave of the outputs is
what stands below them. A smaller r drops leading columns, whose rows are absorbed into the triangle below.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from gtmbench.checks import whole
from gtmbench.errors import InputError
from gtmbench.method.estimators.least_squares import solve
from gtmbench.method.problem import Constant, Problem, Records, Weights, as_records, operator_names, pose_problem
from gtmbench.method.regression.stretches import stretches
from gtmbench.method.regression.triangle import Triangle
from gtmbench.values.record import FloatArray

if TYPE_CHECKING:
    import pandas as pd

ORDERS = (0, 1, 2, 3, 5, 7, 10, 14, 20, 28, 38, 50)  # each some 1.4 times the one before, up to the dissertation's
_MOST_ORDERS = 200  # each is a fit: more is a mistake
_ALLOWANCE = 1.01  # times the least held-out RMS: what lies within is as good

Fit = tuple[int, FloatArray, FloatArray | None]  # rank; sums of squares, shape (outputs,): of fit, of held-out data


@dataclass(frozen=True, kw_only=True, eq=False)
class OrderChoice:
    """Recommended orders r and d, and the evidence.

    Attributes
    ----------
    causal_order, noncausal_order : int
        r and d, as recommended.
    reason : str
        Why, with the figures.
    table : DataFrame
        One row a member: causal_order, noncausal_order, parameters (of an output) and rank, for every output
        ``rms_OUTPUT`` and (with validation) ``heldout_OUTPUT`` in its unit, aic, bic, and (with validation) heldout,
        the root mean square over the outputs of the held-out residuals, each over its output's RMS in the
        identification records.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> rng = np.random.default_rng(1)
    >>> u = rng.standard_normal(1000)
    >>> y = u + 0.5 * np.roll(u, 1) + 0.01 * rng.standard_normal(1000)
    >>> record = gb.Record(np.column_stack([u, y]), channels=["u", "y"], sample_period_s=0.01)
    >>> choice = gb.select_orders(record, inputs=["u"], outputs=["y"], causal_orders=[0, 1, 2], noncausal_orders=[0, 1])
    >>> choice.causal_order, choice.noncausal_order, choice.surface("bic").shape
    (1, 0, (3, 2))
    """

    causal_order: int
    noncausal_order: int
    reason: str
    table: pd.DataFrame = field(repr=False)

    def surface(self, name: str) -> pd.DataFrame:
        """Return a column of the table over r (rows) and d (columns).

        Raises
        ------
        InputError
            If the table has no such column.
        """
        if name not in self.table.columns[2:]:
            raise InputError(f"the table has no column '{name}'; it has {', '.join(self.table.columns[2:])}")
        return self.table.pivot_table(index="causal_order", columns="noncausal_order", values=name)


def select_orders(
    records: Records,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    causal_orders: Iterable[int] | int = ORDERS,
    noncausal_orders: Iterable[int] | int = ORDERS,
    validation: Records | None = None,
    weights: Weights = None,
    constant: Constant = "estimated",
) -> OrderChoice:
    """Identify every r and d of a grid by least squares and recommend one.

    All members fit the same equations (4.8), those of the largest: k = r_max..l-d_max, each with a constant of its own.
    With `validation`, the recommendation is the member of fewest parameters whose held-out residual is within 1 % of
    the least: differences so small depend on the noise draw. Without `validation` it is the least BIC.

    AIC and BIC take the residuals as white, Gaussian and independent from output to output: sums over the outputs of n
    log(residual power / output power), plus 2 or log(n) for each parameter that the data determine. Sensor noise on the
    pseudo inputs makes the residual coloured, and both then choose too many parameters: hold out data if possible.

    Parameters
    ----------
    records : Record or sequence of Record
        Healthy measurements to identify on.
    inputs, outputs : sequence of str
        Pseudo inputs and pseudo outputs.
    causal_orders, noncausal_orders : iterable of int, or int
        Grid of r and d, in samples (by default 0 to 50).
    validation : Record or sequence of Record, optional
        Healthy measurements that nothing was identified on.
    weights : array_like, optional
    constant : str
        As for `identify`.

    Raises
    ------
    InputError
        If no order is given, or the largest can't be identified on the records.

    Notes
    -----
    One Gram matrix and one for validation. Data that don't determine the largest member (noise-free sinusoids don't)
    are solved member by member for the smallest parameters that fit, as `identify` does. That takes longer.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> rng = np.random.default_rng(1)
    >>> u = rng.standard_normal(2000)
    >>> y = np.roll(u, 2) - 0.5 * np.roll(u, -1) + 0.1 * rng.standard_normal(2000)  # lags 2 and -1
    >>> record = gb.Record(np.column_stack([u, y]), channels=["u", "y"], sample_period_s=0.01)
    >>> orders = {"causal_orders": range(6), "noncausal_orders": range(6)}
    >>> choice = gb.select_orders(record, inputs=["u"], outputs=["y"], **orders)
    >>> choice.causal_order, choice.noncausal_order
    (2, 1)
    >>> choice.surface("rms_y").loc[2, [0, 1]].round(1).tolist()
    [0.5, 0.1]
    """
    causal, noncausal = _orders("causal_orders", causal_orders), _orders("noncausal_orders", noncausal_orders)
    u, y = operator_names(inputs, outputs)
    problem = pose_problem(records, u, y, causal[-1], noncausal[-1], weights=weights, constant=constant)
    equations = problem.triangle()
    held = None if validation is None else _held_out(problem, validation).about(equations.means)
    return _choice(_table(problem, equations, held, causal, noncausal), held is not None)


def _orders(name: str, orders: Iterable[int] | int) -> list[int]:
    given = list(islice(orders, _MOST_ORDERS + 1)) if isinstance(orders, Iterable) else [orders]
    distinct = sorted({whole(name, order) for order in given})
    if len(given) > _MOST_ORDERS:
        raise InputError(
            f"{name} holds more than {_MOST_ORDERS} orders; give a coarser grid, for example range(0, 100, 5)"
        )
    if not distinct:
        raise InputError(f"{name} holds no order; give at least one, for example range(20)")
    return distinct


def _held_out(problem: Problem, validation: Records) -> Triangle:
    """Return the triangle of the validation records, in the means and RMS values of identification."""
    others = as_records(validation)
    others[0].check_period(problem.sample_period_s, "those to identify on every")
    parts, _, _ = stretches(others, problem.channels, [None] * len(others), (problem.centre, problem.scale))
    held = replace(problem, stretches=parts)
    if held.equations < 1:
        raise InputError(
            f"{sum(map(len, parts))} samples for validation give no equation with {problem.lags} lags; give more, or "
            "lower the orders"
        )
    return held.triangle()


def _table(
    problem: Problem, equations: Triangle, held: Triangle | None, causal: Sequence[int], noncausal: Sequence[int]
) -> pd.DataFrame:
    """Return one row a model."""
    import pandas as pd

    fits = [fit for row in _rows(equations, held, len(problem.inputs), causal, noncausal) for fit in row]
    rank = np.array([fit[0] for fit in fits])
    nil = equations.tolerance**2  # mean squares below are rounding: one such model is as good as another
    power = np.maximum(np.array([fit[1] for fit in fits]) / equations.weight, nil)
    r, d = np.repeat(causal, len(noncausal)), np.tile(noncausal, len(causal))
    scale = problem.scale[len(problem.inputs) :]
    columns = {
        "causal_order": r,
        "noncausal_order": d,
        "parameters": (r + d + 1) * len(problem.inputs),
        "rank": rank,
        **_by_output("rms", problem.outputs, np.sqrt(power) * scale),
    }
    columns["aic"], columns["bic"] = information(power, equations.weight, rank)
    if held is not None:
        left = np.maximum(np.array([fit[2] for fit in fits]) / held.weight, nil)
        columns |= _by_output("heldout", problem.outputs, np.sqrt(left) * scale)
        columns["heldout"] = np.sqrt(left.mean(axis=1))
    return pd.DataFrame(columns)


def _by_output(what: str, outputs: Sequence[str], values: FloatArray) -> dict[str, FloatArray]:
    return {f"{what}_{name}": column for name, column in zip(outputs, values.T, strict=True)}


def _rows(
    equations: Triangle, held: Triangle | None, count: int, causal: Sequence[int], noncausal: Sequence[int]
) -> list[list[Fit]]:
    """Return the fits of all models of `count` inputs, a list for each r; each triangle is made from that before."""
    nested = equations.full_rank  # then all members are: what they leave out only raises the least singular value
    rows, dropped = [], 0
    for r in reversed(causal):
        equations = equations.drop((causal[-1] - r) * count - dropped)
        dropped = (causal[-1] - r) * count
        sizes = [(r + d + 1) * count for d in noncausal]
        other = None if held is None else held.root[:, dropped:]
        rows.append(list((_leading if nested else _one_by_one)(equations, other, sizes)))
    return rows[::-1]


def _leading(equations: Triangle, held: FloatArray | None, sizes: Sequence[int]) -> Iterator[Fit]:
    """Yield fits of the first columns: what stands below them is left over.

    Parameters are needed for held-out data only: those of j columns are R^-1 q with zeros in q from row j on, so all
    sizes are one triangular solve.
    """
    below = np.cumsum(equations.target[::-1] ** 2, axis=0)[::-1]
    if held is None:
        yield from ((size, below[size], None) for size in sizes)
        return
    from scipy.linalg import lapack

    width = equations.size
    known = np.hstack([equations.target[:width] * (np.arange(width) < size)[:, np.newaxis] for size in sizes])
    theta, _ = lapack.dtrtrs(equations.regressor.T, known, lower=1, trans=1)
    left = np.tile(held[:, width:], len(sizes)) - held[:, :width] @ theta
    squares = np.sum(left**2, axis=0).reshape(len(sizes), -1)
    yield from ((size, below[size], left_over) for size, left_over in zip(sizes, squares, strict=True))


def _one_by_one(equations: Triangle, held: FloatArray | None, sizes: Sequence[int]) -> Iterator[Fit]:
    """Yield fits of the first columns, each solved for by singular values: some lack rank."""
    width = equations.size
    for size in sizes:
        columns = [*range(size), *range(width, equations.root.shape[1])]
        theta, rank = solve(replace(equations, root=equations.root[:, columns]))
        squares, left = (
            np.sum((root[:, width:] - root[:, :size] @ theta) ** 2, axis=0)
            for root in (equations.root, equations.root if held is None else held)
        )
        yield rank, squares, None if held is None else left


def _choice(table: pd.DataFrame, validated: bool) -> OrderChoice:
    """Return the recommendation."""
    by = "heldout" if validated else "bic"
    least = table.loc[table[by].idxmin()]
    good = table[table[by] <= (_ALLOWANCE * least[by] if validated else least[by])]
    best = good.sort_values(["parameters", by]).iloc[0]
    r, d = int(best["causal_order"]), int(best["noncausal_order"])
    said = f"r = {r}, d = {d} ({best['parameters']:.0f} parameters an output)"
    if not validated:
        reason = f"{said} has the least BIC of {len(table)} models, {best['bic']:.6g}; no data were held out"
    elif best.equals(least):
        reason = f"{said} has the least held-out residual of {len(table)} models, {best[by]:.4g} of the outputs' RMS"
    else:
        reason = (
            f"{said} leaves {best[by]:.4g} of the outputs' RMS in held-out data, within 1 % of the least of "
            f"{len(table)} models, {least[by]:.4g}, which takes {least['parameters']:.0f} parameters"
        )
    largest = [what for what, order in (("causal", r), ("noncausal", d)) if order == table[f"{what}_order"].max() > 0]
    if largest:
        reason += f"; the {' and the '.join(largest)} order is the largest tried, so try larger ones"
    return OrderChoice(causal_order=r, noncausal_order=d, reason=reason, table=table)


def information(power: FloatArray, equations: float, rank: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return AIC and BIC of models with `rank` determined parameters an output.

    Residuals are taken as white, Gaussian and independent from output to output; constants are left out.

    `power`, shape (..., outputs): mean squares of the residuals, each over its output's mean square. `rank`, shape
    (...).

    >>> aic, bic = information(np.array([0.01]), 1000.0, 5)
    >>> round(float(aic), 6)  # 1000 log(0.01) + 2 * 5
    -4595.170186
    """
    fit = equations * np.sum(np.log(power), axis=-1)
    count = np.asarray(rank) * power.shape[-1]
    return fit + 2.0 * count, fit + np.log(equations) * count
