"""The residual of an operator on a record, its windowed norm, equations (4.11) and (4.12), threshold and alarms."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from numbers import Real

import numpy as np
from numpy.typing import NDArray

from gtmbench.checks import number, whole
from gtmbench.errors import InputError
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.values.record import BoolArray, FloatArray, Record, check_record, frozen


@dataclass(frozen=True, kw_only=True, eq=False)
class Residual:
    """The one-step residual e(k), row for row beside its record: row k is sample k, NaN where it doesn't exist.

    Attributes
    ----------
    values : shape (samples, outputs)
        In the outputs' units.
    time_s : shape (samples,)
        Times of the samples, in seconds; e(k) is known `look_ahead_s` after them.
    outputs : tuple of str
    look_ahead_s, sample_period_s : float
        d Ts and Ts, in seconds.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> u = np.random.default_rng(1).standard_normal(500)
    >>> healthy = gb.Record(np.column_stack([u, 2.0 * u]), channels=["u", "y"], sample_period_s=0.01)
    >>> operator = gb.identify(healthy, inputs=["u"], outputs=["y"], causal_order=0, noncausal_order=0)
    >>> left = gb.residual(operator, gb.inject(healthy, gb.Bias(channel="y", onset_s=2.0, size=0.5)))
    >>> left.outputs, np.abs(left.values[[0, 300], 0]).round(6).tolist()
    (('y',), [0.0, 0.5])
    """

    values: FloatArray = field(repr=False)
    time_s: FloatArray = field(repr=False)
    outputs: tuple[str, ...]
    look_ahead_s: float
    sample_period_s: float


@dataclass(frozen=True, kw_only=True, eq=False)
class WindowedNorm:
    """The windowed residual norm E(k), one value per row of its record, NaN where its window isn't complete.

    Attributes
    ----------
    values : shape (samples,)
        In the output's unit.
    time_s : shape (samples,)
        Times of the windows' first samples, in seconds; E(k) is known at `known_s`, ``(w + d) Ts`` later.
    window : int
        w: a window holds w + 1 samples, k..k+w.
    look_ahead_s, sample_period_s : float
        d Ts and Ts, in seconds.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> time_s = np.arange(4.0)
    >>> e = gb.Residual(
    ...        values=np.array([[3.0], [4.0], [0.0], [0.0]]), time_s=time_s, outputs=("y",), look_ahead_s=0.5,
    ...     sample_period_s=1.0,
    ... )
    >>> norm = gb.windowed_norm(e, window=1)
    >>> norm.values.tolist(), norm.known_s.tolist()
    ([5.0, 4.0, 0.0, nan], [1.5, 2.5, 3.5, 4.5])
    """

    values: FloatArray = field(repr=False)
    time_s: FloatArray = field(repr=False)
    window: int
    look_ahead_s: float
    sample_period_s: float

    @property
    def known_s(self) -> FloatArray:
        """When each E(k) is known: at (k + w + d) Ts, the time of the last sample that it needs."""
        return self.time_s + self.window * self.sample_period_s + self.look_ahead_s


def residual(operator: Transmissibility, record: Record) -> Residual:
    """Return e(k) = y_o(k) - sum over i = -d..r of H_i y_i(k-i), k = r..l-d, equation (4.11).

    A missing sample makes only the residuals that need it NaN.

    Parameters
    ----------
    operator : Transmissibility
    record : Record
        With the operator's inputs and outputs, of its sample period.

    Raises
    ------
    InputError
        If the record lacks a channel or has another sample period.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> u = np.random.default_rng(1).standard_normal(500)
    >>> healthy = gb.Record(np.column_stack([u, 2.0 * u]), channels=["u", "y"], sample_period_s=0.01)
    >>> operator = gb.identify(healthy, inputs=["u"], outputs=["y"], causal_order=0, noncausal_order=0)
    >>> broken = healthy.replace("y", 2.0 * u + 0.5)
    >>> gb.residual(operator, broken).values[:2].round(9)
    array([[0.5],
           [0.5]])
    """
    check_record(record)
    values = operator.predict(record)
    for o, name in enumerate(operator.outputs):
        np.subtract(record[name], values[:, o], out=values[:, o])
    values.setflags(write=False)
    return Residual(
        values=values,
        time_s=record.time_s,
        outputs=operator.outputs,
        look_ahead_s=operator.look_ahead_s,
        sample_period_s=record.sample_period_s,
    )


def innovations(operator: Transmissibility, record: Record) -> Residual:
    """Return epsilon(k) = A(q) e(k), equation (3.67), of an operator that was identified with a noise model.

    It is white even if the residual e(k) is coloured, and can be watched likewise; k = r+n..l-d.

    Parameters
    ----------
    operator : Transmissibility
        With a noise model.
    record : Record
        As for `residual`.

    Raises
    ------
    InputError
        If the operator has no noise model; otherwise as `residual`.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> rng = np.random.default_rng(1)
    >>> u, w = rng.standard_normal(2000), np.cumsum(rng.standard_normal(2000))
    >>> record = gb.Record(np.column_stack([u, 2.0 * u + w]), channels=["u", "y"], sample_period_s=0.01)
    >>> names = {"inputs": ["u"], "outputs": ["y"], "causal_order": 0, "noncausal_order": 0}
    >>> operator = gb.identify(record, **names, estimator=gb.PredictionError(noise_order=1))
    >>> [round(float(np.nanstd(each(operator, record).values)), 1) for each in (gb.residual, gb.innovations)]
    [11.7, 1.0]
    """
    left = residual(operator, record)
    if operator.noise_model is None:
        raise InputError(f"the operator {operator.name} has no noise model; identify it by PredictionError(...)")
    return replace(left, values=frozen(operator.noise_model.innovations(left.values)))


def windowed_norm(residual: Residual, *, window: int) -> WindowedNorm:
    """Return E(k) = sqrt(sum over i = k..k+w of ||e(i)||^2), equation (4.12), for every complete window.

    It is exact after any spike, and a missing residual affects only the windows that hold it: the sums are built from
    prefix and suffix sums of blocks of a window's length, never by subtraction.

    Parameters
    ----------
    residual : Residual
    window : int
        w; w + 1 squares are summed.

    Raises
    ------
    InputError
        If the window is negative.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> e = gb.Residual(values=np.array([[3.0], [4.0], [0.0]]), time_s=np.arange(3.0), outputs=("y",), look_ahead_s=0.0,
    ...                 sample_period_s=1.0)
    >>> gb.windowed_norm(e, window=1).values
    array([ 5.,  4., nan])
    """
    window = whole("window", window)
    return WindowedNorm(
        values=frozen(np.sqrt(moving_sum(squares(residual), window + 1))),
        time_s=residual.time_s,
        window=window,
        look_ahead_s=residual.look_ahead_s,
        sample_period_s=residual.sample_period_s,
    )


@np.errstate(over="ignore")  # a residual of 1e200 has a square of inf: above every threshold
def squares(residual: Residual) -> FloatArray:
    """Return ||e(k)||^2, shape (samples,): outputs are added in order, so that a row gives the same in any company."""
    columns = residual.values.T
    total: FloatArray = np.square(columns[0])
    for column in columns[1:]:
        total += np.square(column)
    return total


@np.errstate(over="ignore")
def moving_sum(values: FloatArray, length: int) -> FloatArray:
    """Return sums of `length` values from each index on, NaN where they would run over the end."""
    count, complete = len(values), len(values) - length + 1
    sums = np.full(count, np.nan)
    if complete < 1:
        return sums
    blocks = np.zeros((-(-count // length), length))
    blocks.ravel()[:count] = values
    suffix = np.empty_like(blocks)
    np.cumsum(blocks[:, ::-1], axis=1, out=suffix[:, ::-1])
    prefix = np.cumsum(blocks, axis=1, out=blocks).ravel()
    suffix = suffix.ravel()[:complete]
    # a window is the end of one block and the beginning of the next, or a whole block
    np.add(suffix, prefix[length - 1 : count], out=sums[:complete])
    sums[:complete:length] = suffix[::length]
    return sums


@dataclass(frozen=True, kw_only=True, eq=False)
class Alarms:
    """Upward crossings of a threshold.

    Attributes
    ----------
    time_s : shape (alarms,)
        When each alarm could be raised: (k + w + d) Ts for a crossing at window k.
    armed_s : float
        When the norm was first known to be at or below the threshold: from then on alarms are possible. NaN if never.
    threshold : float
        In the norm's unit.
    look_ahead_s, window_s : float
        d Ts and (w + 1) Ts: the spans of samples after k and from k on that an alarm at k has seen.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> norm = gb.WindowedNorm(
    ...        values=np.array([0.1, 0.2, 3.0]), time_s=np.arange(3.0), window=0, look_ahead_s=0.5, sample_period_s=1.0
    ... )
    >>> found = gb.alarms(norm, threshold=1.0)
    >>> found.time_s.tolist(), found.armed_s
    ([2.5], 0.5)
    """

    time_s: FloatArray
    armed_s: float
    threshold: float
    look_ahead_s: float
    window_s: float


def threshold(norm: WindowedNorm, *, start_s: float, end_s: float, factor: float = 1.5) -> float:
    """Return a threshold from a healthy record: `factor` times the greatest E(k) with start_s <= k Ts <= end_s.

    Parameters
    ----------
    norm : WindowedNorm
        Of a healthy record.
    start_s, end_s : float
        The span of k Ts to use, in seconds.
    factor : float
        Times the greatest E(k).

    Raises
    ------
    InputError
        If no complete window begins in that span.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> norm = gb.WindowedNorm(values=np.array([9.0, 1.0, 2.0]), time_s=np.arange(3.0), window=0,
    ...                        look_ahead_s=0.0, sample_period_s=1.0)
    >>> gb.threshold(norm, start_s=1.0, end_s=2.0, factor=1.5)
    3.0
    """
    factor = number("factor", factor, 0.0, above=True)
    inside = (norm.time_s >= start_s - 1e-9) & (norm.time_s <= end_s + 1e-9) & np.isfinite(norm.values)
    if not inside.any():
        raise InputError(
            f"no complete window begins in {start_s:g}..{end_s:g} s, so there is no threshold; choose another span, "
            "a shorter window or a longer record"
        )
    return float(factor * norm.values[inside].max())


def check_start(start_s: float) -> None:
    """Refuse a time to watch from that isn't one; -inf means from the first window on."""
    if not isinstance(start_s, Real) or isinstance(start_s, bool) or not start_s < np.inf:
        raise InputError(f"start_s is {start_s!r}; give seconds")


def came_down(values: FloatArray, threshold: float) -> BoolArray:
    """Return where a score is armed, shape (samples,): it exists, and it or one before was at or below the threshold.

    The one arming rule: what stands above from the start has to come down before it can alarm.

    >>> came_down(np.array([3.0, np.nan, 1.0, 4.0, np.nan]), 2.0).tolist()
    [False, False, True, True, False]
    """
    there = ~np.isnan(values)
    with np.errstate(invalid="ignore"):
        low = there & (values <= threshold)
    return np.asarray(there & np.logical_or.accumulate(low))


def rising(values: FloatArray, threshold: float) -> NDArray[np.int_]:
    """Return the rows where a score rises above its threshold, having been at or below it; NaN is passed over.

    >>> rising(np.array([3.0, 1.0, np.nan, 4.0, 5.0, 1.0, 6.0]), 2.0).tolist()
    [3, 6]
    """
    there = np.flatnonzero(~np.isnan(values))
    above = values[there] > threshold
    return np.asarray(there[above & ~np.concatenate([[True], above])[:-1]])


def alarms(norm: WindowedNorm, threshold: float, *, start_s: float = -np.inf) -> Alarms:
    """Return the alarms of windows that begin at or after `start_s`.

    An alarm is a window above the threshold after one at or below it. A norm that is above from the start (a flight's
    transient) must come down first. Windows with missing samples are passed over.

    Parameters
    ----------
    norm : WindowedNorm
    threshold : float
        In the norm's unit.
    start_s : float
        k Ts of the first window that is watched, in seconds, by default all.

    Raises
    ------
    InputError
        If the threshold isn't a positive number.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> norm = gb.WindowedNorm(values=np.array([0.0, 2.0, 2.0, 0.0, 2.0]), time_s=np.arange(5.0), window=0,
    ...                        look_ahead_s=0.5, sample_period_s=1.0)
    >>> gb.alarms(norm, 1.0).time_s
    array([1.5, 4.5])
    """
    threshold = number("threshold", threshold, 0.0, above=True)
    check_start(start_s)
    watched = norm.time_s >= start_s - 1e-9
    values, known_s = norm.values[watched], norm.known_s[watched]
    armed = came_down(values, threshold)
    return Alarms(
        time_s=frozen(known_s[rising(values, threshold)]),
        armed_s=float(known_s[np.argmax(armed)]) if armed.any() else float("nan"),
        threshold=threshold,
        look_ahead_s=norm.look_ahead_s,
        window_s=(norm.window + 1) * norm.sample_period_s,
    )
