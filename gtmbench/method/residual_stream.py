"""Residual, E(k) and alarms as the samples come in: chunk for chunk what the batch functions give for all at once.

Each stream takes and returns the values of its batch function: `residual`, `windowed_norm` or `alarms`. Laid end to
end, what it returned is what the whole record gives, as far as it is known. It remembers its taps or one window, never
the flight, so that a sample costs the same at any time. A chunk that is refused changes nothing.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gtmbench.checks import number, whole
from gtmbench.method.residual import Alarms, Residual, WindowedNorm, alarms, check_start, residual, squares
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.values.clock import ChunkClock, advanced
from gtmbench.values.record import FloatArray, Record, check_record, frozen


class ResidualStream:
    """The residual (4.11) of a record that arrives in chunks: e(k) is returned with sample k + d.

    Parameters
    ----------
    operator : Transmissibility

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> u = np.random.default_rng(1).standard_normal(500)
    >>> record = gb.Record(np.column_stack([u, np.roll(u, -1)]), channels=["u", "y"], sample_period_s=0.01)
    >>> operator = gb.identify(record, inputs=["u"], outputs=["y"], causal_order=0, noncausal_order=1)
    >>> stream = gb.ResidualStream(operator)
    >>> [stream.push(record.between(start, end)).time_s.tolist() for start, end in [(0.0, 0.02), (0.03, 0.03)]]
    [[0.0, 0.01], [0.02]]
    """

    def __init__(self, operator: Transmissibility) -> None:
        self._operator = operator
        self._channels = (*operator.inputs, *operator.outputs)
        self._clock: ChunkClock | None = None
        self._tail = np.zeros((0, len(self._channels)))  # the last r + d samples

    def push(self, record: Record) -> Residual:
        """Return the rows that a chunk's samples complete, rows k < r (NaN) included.

        Raises
        ------
        InputError
            If the chunk doesn't continue the one before, lacks a channel or isn't sampled as the operator is.
        """
        check_record(record)
        chunk = ChunkClock(
            start_s=record.start_s, sample_period_s=record.sample_period_s, source="the operator", count=len(record)
        )
        clock = advanced(self._clock, chunk)
        values = np.concatenate([self._tail, record.matrix(self._channels)])
        joined = Record(values, channels=self._channels, sample_period_s=clock.sample_period_s)
        whole = residual(self._operator, joined)
        known = clock.known(len(record), self._operator.noncausal_order)
        row_0 = clock.count - len(joined)  # which sample that is
        self._tail = values[max(len(values) - len(self._operator.markov) + 1, 0) :].copy()  # a view would hold it all
        self._clock = clock
        return replace(
            whole, values=whole.values[known.start - row_0 : known.stop - row_0], time_s=clock.times_s(known)
        )


class NormStream:
    """E(k), equation (4.12), of a residual that arrives in chunks: E(k) is returned with row k + w, bit for bit.

    The scheme of `windowed_norm`, blocks of w + 1 rows counted from the first: a window is the end of the block before
    and the beginning of this one.

    Parameters
    ----------
    window : int
        w, as `windowed_norm` takes it.

    Raises
    ------
    InputError
        If the window is negative.

    Examples
    --------
    >>> from dataclasses import replace
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> e = gb.Residual(values=np.array([[3.0], [4.0]]), time_s=np.arange(2.0), outputs=("y",), look_ahead_s=0.0,
    ...                 sample_period_s=1.0)
    >>> stream = gb.NormStream(window=1)
    >>> stream.push(e).values, stream.push(replace(e, time_s=np.arange(2.0, 4.0))).values
    (array([5.]), array([5., 5.]))
    """

    def __init__(self, *, window: int) -> None:
        self._window = whole("window", window)
        self._clock: ChunkClock | None = None
        self._ends = np.full(self._window + 2, np.nan)  # sums from each row of the block before to its end
        self._block = np.zeros(self._window + 1)  # squares of this block,
        self._filled = 0  # so many of them,
        self._sum = 0.0  # and their sum

    def push(self, residual: Residual) -> WindowedNorm:
        """Return E(k) of the windows that a chunk's rows complete.

        Raises
        ------
        InputError
            If the chunk doesn't continue the one before.
        """
        source = f"outputs {', '.join(residual.outputs)} with a look-ahead of {residual.look_ahead_s} s"
        clock = advanced(self._clock, ChunkClock.of(residual.time_s, residual.sample_period_s, source))
        rows, length = len(residual.time_s), self._window + 1
        parts = np.split(squares(residual), range(length - self._filled, rows, length))
        sums = np.concatenate([self._take(part) for part in parts])
        known = clock.known(rows, self._window)
        self._clock = clock
        return WindowedNorm(
            values=frozen(np.sqrt(sums[rows - len(known) :])),
            time_s=clock.times_s(known),
            window=self._window,
            look_ahead_s=residual.look_ahead_s,
            sample_period_s=clock.sample_period_s,
        )

    @np.errstate(over="ignore")
    def _take(self, part: FloatArray) -> FloatArray:
        """Take squares of this block; return the sums of the windows that they end."""
        begin, end = self._filled, self._filled + len(part)
        self._block[begin:end] = part
        beginnings = np.cumsum(np.append(self._sum, part))
        sums: FloatArray = self._ends[begin + 1 : end + 1] + beginnings[1:]
        self._filled, self._sum = end, beginnings[-1]
        if end == len(self._block):
            self._ends[:-1] = np.cumsum(self._block[::-1])[::-1]
            sums[-1] = self._ends[0]  # a whole block, added as `windowed_norm` adds it
            self._filled, self._sum = 0, 0.0
        return sums


class AlarmStream:
    """The alarms of a windowed norm that arrives in chunks.

    Parameters
    ----------
    threshold, start_s
        As `alarms` takes them.

    Raises
    ------
    InputError
        If the threshold isn't a positive number.

    Examples
    --------
    >>> from dataclasses import replace
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> norm = gb.WindowedNorm(values=np.array([0.0, 2.0]), time_s=np.arange(2.0), window=0, look_ahead_s=0.5,
    ...                        sample_period_s=1.0)
    >>> stream = gb.AlarmStream(1.0)
    >>> stream.push(norm).time_s, stream.push(replace(norm, time_s=np.arange(2.0, 4.0))).time_s
    (array([1.5]), array([3.5]))
    """

    def __init__(self, threshold: float, *, start_s: float = -np.inf) -> None:
        self._threshold = number("threshold", threshold, 0.0, above=True)
        check_start(start_s)
        self._start_s = start_s
        self._clock: ChunkClock | None = None
        self._last = np.zeros((2, 0))  # time and value of the last window without missing samples
        self._armed_s = float("nan")

    def push(self, norm: WindowedNorm) -> Alarms:
        """Return the alarms that a chunk raises; `armed_s` is NaN until the norm has come down.

        Raises
        ------
        InputError
            If the chunk doesn't continue the one before.
        """
        source = f"windows of {norm.window + 1} samples with a look-ahead of {norm.look_ahead_s} s"
        clock = advanced(self._clock, ChunkClock.of(norm.time_s, norm.sample_period_s, source))
        time_s, values = both = np.hstack([self._last, [norm.time_s, norm.values]])
        crossings = alarms(replace(norm, time_s=time_s, values=values), self._threshold, start_s=self._start_s)
        self._last = both[:, np.flatnonzero(~np.isnan(values))[-1:]]
        self._armed_s = crossings.armed_s if np.isnan(self._armed_s) else self._armed_s
        self._clock = clock
        return replace(crossings, armed_s=self._armed_s)
