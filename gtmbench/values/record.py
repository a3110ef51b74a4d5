"""`Record`: the one value that flows, evenly sampled channels with their time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gtmbench.checks import meant, number
from gtmbench.errors import InputError
from gtmbench.values.channels import CHANNELS, channel_of, unit_of
from gtmbench.values.clock import FloatArray as FloatArray
from gtmbench.values.clock import check_span, even_period_s, even_times_s, same_period
from gtmbench.values.notebook import card, figure
from gtmbench.values.pieces import beside

if TYPE_CHECKING:
    import pandas as pd

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
Span = tuple[float, float]


def check_record(given: object) -> None:
    """Refuse what isn't a Record, with a hint for what can be made one."""
    if not isinstance(given, Record):
        raise InputError(
            f"a {type(given).__name__} was given for a Record; wrap it with Record(...) or Record.from_frame(...)"
        )


def frozen(values: ArrayLike, *, order: Literal["K", "F"] = "K") -> FloatArray:
    """Return a read-only copy as float64; with order F, its columns lie together in memory."""
    if order == "F" and isinstance(values, np.ndarray) and _is_frozen(values):
        return values
    return sealed(np.array(values, dtype=np.float64, order=order))


def _is_frozen(values: NDArray[Any]) -> bool:
    """Tell whether nobody can write to an array, whose columns lie together in memory."""
    base = values if values.base is None else values.base
    return (
        values.dtype == np.float64
        and values.ndim == 2
        and not values.flags.writeable
        and isinstance(base, np.ndarray)
        and base.base is None
        and not base.flags.writeable
        and len(values) > 1
        and values.strides[0] == values.itemsize
    )


def sealed(array: FloatArray) -> FloatArray:
    """Return an array that nobody else holds, read-only from now on."""
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Record:
    """Time-stamped channels, evenly sampled; NaN stands for a missing sample.

    Parameters
    ----------
    values : array_like, shape (samples, channels)
        Copied, then read-only. One channel may be a vector.
    channels : sequence of str
        One name a column. Names of the channel table carry its units; others are taken as they are.
    sample_period_s : float
        Ts, in seconds.
    start_s : float
        Time of sample 0, in seconds: sample k is at ``start_s + k Ts``.
    there : array_like, shape (samples, channels), optional
        Where a sample exists although its value is unknown: beside a pause a low-pass gives none, and a log may leave
        out single ones. By default samples exist where values are finite.

    Raises
    ------
    InputError
        If shapes, names or times are invalid.

    Examples
    --------
    >>> import gtmbench as gb
    >>> record = gb.Record([[1.0, 0.5], [2.0, 0.25]], channels=["p", "q"], sample_period_s=0.01)
    >>> len(record), record["q"], record.time_s
    (2, array([0.5 , 0.25]), array([0.  , 0.01]))
    """

    values: FloatArray
    channels: tuple[str, ...]
    sample_period_s: float
    start_s: float
    _there: BoolArray | None = field(init=False)

    def __init__(
        self,
        values: ArrayLike,
        *,
        channels: Sequence[str],
        sample_period_s: float,
        start_s: float = 0.0,
        there: ArrayLike | None = None,
    ) -> None:
        try:
            array = frozen(values, order="F")  # a channel is read far more often than a row
        except (TypeError, ValueError) as error:
            raise InputError(f"a record's values must be numbers in rows of equal length: {error}") from error
        names = (channels,) if isinstance(channels, str) else tuple(channels)
        if array.ndim == 1 and len(names) == 1:
            array = frozen(array[:, np.newaxis])
        if array.ndim != 2 or array.shape[1] != len(names):
            raise InputError(
                f"values of shape {array.shape} don't fit {len(names)} channels; give (samples, {len(names)})"
            )
        if not all(isinstance(name, str) and name.strip() and name.isprintable() for name in names):
            raise InputError(f"channel names must be words, given: {', '.join(map(repr, names))[:200]}")
        if len(set(names)) != len(names):
            twice = sorted({name for name in names if names.count(name) > 1})
            raise InputError(f"channel names must differ; given twice: {', '.join(twice)}")
        object.__setattr__(self, "values", array)
        object.__setattr__(self, "channels", names)
        object.__setattr__(self, "sample_period_s", number("sample_period_s", sample_period_s, 0.0, above=True))
        object.__setattr__(self, "start_s", number("start_s", start_s))
        object.__setattr__(self, "_there", None if there is None else _mask(there, array))

    def __repr__(self) -> str:
        return (
            f"Record({len(self)} samples, {self.start_s:g}..{self.end_s:g} s, every {self.sample_period_s:g} s: "
            f"{', '.join(self.channels)})"
        )

    def _repr_html_(self) -> str:
        facts = {
            "samples": f"{len(self)}, every {self.sample_period_s:g} s",
            "time": f"{self.start_s:g} to {self.end_s:g} s",
        }
        columns = ("channel", "unit", "least", "mean", "greatest", "deviation", "missing")
        rows = [(name, unit_of(name), *_summary(self[name])) for name in self.channels]
        return card("Record", facts, columns=columns, rows=rows)

    def __len__(self) -> int:
        return int(self.values.shape[0])

    def __contains__(self, channel: str) -> bool:
        return channel in self.channels

    def __getitem__(self, channel: str) -> FloatArray:
        """Return one channel, shape (samples,), read-only."""
        if channel not in self.channels:
            self.columns([channel])  # refuses it
        return self.values[:, self.channels.index(channel)]

    @property
    def there(self) -> BoolArray:
        """Where a sample exists, shape (samples, channels): its value is finite or unknown."""
        return np.isfinite(self.values) if self._there is None else self._there

    @property
    def is_in_part_unknown(self) -> bool:
        """Whether samples may exist whose values are unknown."""
        return self._there is not None

    @property
    def time_s(self) -> FloatArray:
        """Time of every sample in seconds, rounded to the nanosecond."""
        return even_times_s(self.start_s, self.sample_period_s, range(len(self)))

    def time_at(self, row: int) -> float:
        """Return the time of one sample in seconds, as `time_s` has it."""
        return float(even_times_s(self.start_s, self.sample_period_s, range(row, row + 1))[0])

    @property
    def end_s(self) -> float:
        """Time of the last sample in seconds."""
        return self.start_s + round((len(self) - 1) * self.sample_period_s, 9)

    def columns(self, channels: Sequence[str]) -> list[int]:
        """Return the numbers of the named channels' columns."""
        missing = [name for name in channels if name not in self.channels]
        if missing:
            names = ", ".join(f"'{name}'" for name in missing)
            likely = meant(missing[0], self.channels)
            raise InputError(f"no channel {names} in this record; it has {', '.join(self.channels)}{likely}")
        return [self.channels.index(name) for name in channels]

    def matrix(self, channels: Sequence[str]) -> FloatArray:
        """Return the named channels as columns, shape (samples, len(channels)), read-only."""
        columns = self.values[:, self.columns(channels)]
        columns.setflags(write=False)
        return columns

    def check_period(self, sample_period_s: float, other: str) -> None:
        """Raise an InputError if this record has another sample period; `other` names the owner of the given one."""
        if not same_period(self.sample_period_s, sample_period_s):
            raise InputError(
                f"the record is sampled every {self.sample_period_s:g} s, {other} {sample_period_s:g} s; resample it "
                "or identify anew"
            )

    def select(self, channels: Sequence[str]) -> Record:
        """Return a record of the named channels only, in that order."""
        columns = self.columns(channels)
        if len(columns) == len(self.channels) and columns == list(range(len(columns))):
            return self
        there = None if self._there is None else self._there[:, columns]
        return self._with(self.values[:, columns], tuple(channels), self.start_s, there)

    def replace(self, channel: str, values: ArrayLike) -> Record:
        """Return a record in which one channel has other values."""
        place = self.columns([channel])[0]
        column = frozen(values)
        if column.shape != (len(self),):
            raise InputError(f"values of shape {column.shape} don't replace a channel of {len(self)} samples")
        changed = self.values.copy(order="F")
        changed[:, place] = column
        there = self._there
        if there is not None:
            there = there.copy()
            there[:, place] &= ~np.isfinite(self.values[:, place])  # what wasn't known still isn't
        return self._with(changed, self.channels, self.start_s, there)

    def sample_range(self, start_s: float, end_s: float) -> range:
        """Return the sample numbers from start to end, both ends included.

        Raises
        ------
        InputError
            If the span is empty or reaches outside the record.
        """
        tolerance = 1e-6  # of a sample: times are written as decimals
        first = np.ceil((start_s - self.start_s) / self.sample_period_s - tolerance)
        last = np.floor((end_s - self.start_s) / self.sample_period_s + tolerance)
        if not 0 <= first <= last < len(self):  # so for NaN, too
            raise InputError(
                f"{start_s:g}..{end_s:g} s isn't a span of this record, which runs from {self.start_s:g} to "
                f"{self.end_s:g} s; choose a start before the end, both inside"
            )
        return range(int(first), int(last) + 1)

    def between(self, start_s: float, end_s: float) -> Record:
        """Return the part from start to end in seconds, both ends included.

        >>> record = Record(range(50_001), channels=["p"], sample_period_s=0.01)
        >>> part = record.between(25, 200)
        >>> len(part), part["p"][0], part["p"][-1]
        (17501, np.float64(2500.0), np.float64(20000.0))
        """
        span = self.sample_range(start_s, end_s)
        return self.part(span)

    def part(self, rows: range) -> Record:
        """Return consecutive rows without copying them."""
        start = self.start_s + round(rows.start * self.sample_period_s, 9)
        there = None if self._there is None else self._there[rows.start : rows.stop]
        return self._with(self.values[rows.start : rows.stop], self.channels, start, there)

    def frame(self) -> pd.DataFrame:
        """Return a DataFrame: one column a channel, the index ``time_s``."""
        import pandas as pd

        index = pd.Index(self.time_s, name="time_s")
        return pd.DataFrame(self.values.copy(), index=index, columns=list(self.channels))

    @classmethod
    def from_frame(cls, frame: pd.DataFrame, *, sample_period_s: float | None = None) -> Record:
        """Wrap a DataFrame whose time is its index or a column ``time_s``.

        Columns are channels, by name (``p``) or by log header (``p_deg_s``). With `sample_period_s` given, only the
        start and the end of the frame's own time are used: stamps may be rounded, but rows may not be missing.

        Raises
        ------
        InputError
            If there is no time, or it isn't even.

        Examples
        --------
        >>> import pandas as pd
        >>> Record.from_frame(pd.DataFrame({"time_s": [5.0, 5.1, 5.2], "p": [1.0, 2.0, 3.0]})).sample_period_s
        0.1
        """
        time: ArrayLike | None = None
        if "time_s" in frame.columns:
            time = frame["time_s"].to_numpy()
            frame = frame.drop(columns="time_s")
        elif frame.index.name == "time_s":
            time = frame.index.to_numpy()
        if time is None and sample_period_s is None:
            raise InputError(
                "a frame needs its time: a column or an index named 'time_s', in seconds, or sample_period_s"
            )
        names = [str(name) if name in CHANNELS else channel_of(str(name)) for name in frame.columns]
        columns = [_numbers(str(name), frame.iloc[:, i].to_numpy()) for i, name in enumerate(frame.columns)]
        values = np.column_stack(columns) if columns else np.zeros((len(frame), 0))
        time_s = None if time is None else _numbers("time_s", time)
        if sample_period_s is None:
            sample_period_s = even_period_s(np.zeros(0) if time_s is None else time_s)
        start_s = float(time_s[0]) if time_s is not None and len(time_s) else 0.0
        if time_s is not None and len(time_s) > 1:
            check_span(time_s, sample_period_s)
        return cls(values, channels=names, sample_period_s=sample_period_s, start_s=start_s)

    def _with(self, values: FloatArray, channels: Sequence[str], start_s: float, there: BoolArray | None) -> Record:
        return Record(values, channels=channels, sample_period_s=self.sample_period_s, start_s=start_s, there=there)


def _summary(channel: FloatArray) -> tuple[str, ...]:
    """Return a channel's least, mean and greatest value, its deviation, and how many samples are missing, as words."""
    there = channel[np.isfinite(channel)]
    missing = str(len(channel) - len(there))
    if not len(there):
        return "-", "-", "-", "-", missing
    return *(figure(float(each)) for each in (there.min(), there.mean(), there.max(), there.std())), missing


def _mask(there: ArrayLike, values: FloatArray) -> BoolArray | None:
    """Return where samples are there; None where that are those that are finite."""
    given = np.asarray(there, dtype=bool)
    if given.shape != values.shape:
        raise InputError(f"what is there has shape {given.shape}, values have {values.shape}; give one for each")
    if not any(np.any(told & ~np.isfinite(column)) for told, column in zip(given.T, values.T, strict=True)):
        return None
    mask = given | np.isfinite(values)
    mask.setflags(write=False)
    return mask


def _numbers(name: str, column: ArrayLike) -> FloatArray:
    array = np.asarray(column)
    if array.dtype.kind in "mM":
        raise InputError(f"column '{name}' holds dates; give seconds, for example (t - t[0]).total_seconds()")
    try:
        return array.astype(np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"column '{name}' must hold numbers: {error}") from error


def joined(parts: Sequence[Record]) -> Record:
    """Return records of the same channels, each of which goes on from the one before, as one.

    >>> parts = [Record([1.0, 2.0], channels=["p"], sample_period_s=1.0)]
    >>> parts.append(Record([3.0], channels=["p"], sample_period_s=1.0, start_s=2.0))
    >>> joined(parts)["p"]
    array([1., 2., 3.])
    """
    first = parts[0]
    values = np.concatenate([part.values for part in parts])  # noqa: PD011
    there = np.concatenate([part.there for part in parts]) if any(part.is_in_part_unknown for part in parts) else None
    period_s = first.sample_period_s
    return Record(values, channels=first.channels, sample_period_s=period_s, start_s=first.start_s, there=there)


def with_columns(record: Record, channels: Sequence[str], columns: Sequence[FloatArray]) -> Record:
    """Return a record with channels behind its own, in matrices of as many rows, NaN where there is no sample."""
    there = None
    if record.is_in_part_unknown:
        there = beside([record.there, *(np.isfinite(values) for values in columns)])
    return Record(
        beside([record.values, *columns]),  # noqa: PD011
        channels=[*record.channels, *channels],
        sample_period_s=record.sample_period_s,
        start_s=record.start_s,
        there=there,
    )


def runs(true: BoolArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return where runs of True begin, and where they have ended.

    >>> runs(np.array([True, False, True, True]))
    (array([0, 2]), array([1, 4]))
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], true, [False]]).astype(np.int8)))
    return edges[::2], edges[1::2]
