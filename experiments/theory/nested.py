"""Operators with one pseudo input more each, T_1, T_2, ..., whose residuals chapter 4 counts excitations by."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

from gtmbench.errors import RankWarning
from gtmbench.method.identify import identify
from gtmbench.method.residual import WindowedNorm, residual, windowed_norm
from gtmbench.method.selection.inputs import count_excitations
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.values.record import Record


def nested_operators(healthy: Record, order: int) -> tuple[Transmissibility, ...]:
    """Identify T_i, i = 1..p-1, from the first i channels to the last one, (4.9), with r = d = order.

    There is no RankWarning, for noise-free sinusoids lack rank by their nature: ask the operators for their `rank`.

    Examples
    --------
    >>> import numpy as np
    >>> u = np.random.default_rng(1).standard_normal((500, 2))
    >>> record = Record(np.column_stack([u, u @ [2.0, 1.0]]), channels=["a", "b", "c"], sample_period_s=1.0)
    >>> [operator.inputs for operator in nested_operators(record, 0)]
    [('a',), ('a', 'b')]
    """
    *inputs, output = healthy.channels
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RankWarning)
        return tuple(
            identify(healthy, inputs=inputs[:m], outputs=[output], causal_order=order, noncausal_order=order)
            for m in range(1, len(inputs) + 1)
        )


def norms(operators: Sequence[Transmissibility], record: Record, *, window: int) -> tuple[WindowedNorm, ...]:
    """Return E(k), (4.12), of each operator's residual on a record."""
    return tuple(windowed_norm(residual(operator, record), window=window) for operator in operators)


def count(record: Record, order: int) -> int:
    """Return how many excitations are found with r = d = order; as many as channels stands for "no fewer than p - 1".

    Every choice of pseudo inputs and outputs takes part, not only those of T_1, T_2, ...

    Examples
    --------
    >>> import numpy as np
    >>> u, rng = np.random.default_rng(1).standard_normal((2000, 1)), np.random.default_rng(2)
    >>> values = u @ [[1.0, 2.0, 3.0]] + 0.01 * rng.standard_normal((2000, 3))
    >>> count(Record(values, channels=["a", "b", "c"], sample_period_s=1.0), 2)
    1
    """
    choice = count_excitations(record, channels=record.channels, causal_order=order, noncausal_order=order)
    return choice.excitations or len(record.channels)
