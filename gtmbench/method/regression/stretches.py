"""Stretches of consecutive samples: what is left of the records once gaps and bad samples are cut out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce

import numpy as np

from gtmbench.errors import InputError
from gtmbench.values.record import FloatArray, Record

CHUNK = 1 << 15  # samples that are scaled at a time


@dataclass(frozen=True, kw_only=True, eq=False)
class Stretch:
    """Consecutive samples of some channels, centred and scaled when they are read."""

    values: FloatArray = field(repr=False)  # shape (channels, samples)
    weights: FloatArray | None = None  # shape (samples,): of the equation at each sample; None: 1 everywhere
    scaling: Scaling | None = None  # what is still to be done to `values`; None: nothing

    def __len__(self) -> int:
        return int(self.values.shape[1])

    @property
    def channels(self) -> int:
        """How many channels are read."""
        return len(self.values) if self.scaling is None else len(self.scaling.centre)

    def read(self, start: int, stop: int) -> FloatArray:
        """Return samples start..stop-1, shape (channels, stop - start), centred and scaled."""
        block = self.values[:, start:stop]
        return block if self.scaling is None else self.scaling.of(block)

    def recorded(self, start: int, stop: int) -> FloatArray:
        """Return these samples as they were recorded."""
        block = self.values[:, start:stop]
        return block if self.scaling is None else block[self.scaling.rows]

    def freed(self, centre: FloatArray, rms: FloatArray) -> Stretch:
        """Return the stretch with other means and RMS values to read it by."""
        rows = np.arange(len(self.values)) if self.scaling is None else self.scaling.rows
        return replace(self, scaling=Scaling(rows=rows, centre=centre, rms=rms))

    def replace(self, values: FloatArray, skipped: int = 0) -> Stretch:
        """Return a stretch of other values, as read, that begin `skipped` samples later."""
        end = skipped + values.shape[1]
        return Stretch(values=values, weights=None if self.weights is None else self.weights[skipped:end])


@dataclass(frozen=True, kw_only=True, eq=False)
class Scaling:
    """Which rows of a recorded block are read, the mean that is subtracted and the RMS that they are divided by."""

    rows: np.ndarray[tuple[int], np.dtype[np.intp]]
    centre: FloatArray
    rms: FloatArray

    def of(self, block: FloatArray) -> FloatArray:
        """Return the rows, centred and scaled."""
        scaled = block[self.rows]
        scaled -= self.centre[:, np.newaxis]
        scaled *= 1.0 / self.rms[:, np.newaxis]
        return scaled


@dataclass(frozen=True, kw_only=True)
class Run:
    """Equations of the windows that begin at first..first + equations - 1 of a stretch."""

    stretch: Stretch
    first: int
    equations: int
    weight: float | None

    def weights(self, start: int, stop: int, causal_order: int) -> FloatArray:
        """Return those of equations start..stop-1; a window's equation stands at its sample r."""
        if self.weight is not None or self.stretch.weights is None:
            return np.full(stop - start, 1.0 if self.weight is None else self.weight)
        return self.stretch.weights[self.first + causal_order :][start:stop]

    def total(self, causal_order: int) -> float:
        """Return the sum of all weights."""
        if self.weight is not None:
            return self.weight * self.equations
        return float(self.weights(0, self.equations, causal_order).sum())


def runs(stretches: Sequence[Stretch], causal_order: int, noncausal_order: int) -> Iterator[Run]:
    """Yield all equations: runs of one weight if they are long (2 L and more), and what lies between them."""
    lags = causal_order + noncausal_order + 1
    for stretch in stretches:
        count = len(stretch) - lags + 1
        if count <= 0:
            continue
        if stretch.weights is None:
            yield Run(stretch=stretch, first=0, equations=count, weight=1.0 if count >= 2 * lags else None)
            continue
        weights = stretch.weights[causal_order : causal_order + count]
        edges = np.concatenate([[0], np.flatnonzero(np.diff(weights)) + 1, [count]])
        long = np.flatnonzero(np.diff(edges) >= 2 * lags)
        after = 0
        for first, stop in zip(edges[long].tolist(), edges[long + 1].tolist(), strict=True):
            if first > after:
                yield Run(stretch=stretch, first=after, equations=first - after, weight=None)
            yield Run(stretch=stretch, first=first, equations=stop - first, weight=float(weights[first]))
            after = stop
        if count > after:
            yield Run(stretch=stretch, first=after, equations=count - after, weight=None)


def stretches(
    records: Sequence[Record],
    channels: Sequence[str],
    weights: Sequence[FloatArray | None],
    others: tuple[FloatArray, FloatArray] | None = None,
) -> tuple[tuple[Stretch, ...], FloatArray, FloatArray]:
    """Return the stretches of samples that count, and the means and RMS values that they are freed of.

    These are the samples' own (weighted), unless those of `others` are given.

    InputError naming the channel that is missing or holds NaN where it counts.
    """
    parts = [part for record, own in zip(records, weights, strict=True) for part in _parts(record, channels, own)]
    if not sum(map(len, parts)):
        raise InputError("no sample is left to identify from: the records are empty, or every weight is 0")
    with np.errstate(invalid="ignore", over="ignore"):
        centre, rms = _moments(parts)
    if not np.all(np.isfinite(rms)):
        _refuse_missing(records, channels, weights)
    if others is not None:
        centre, rms = others
    return tuple(part.freed(centre, rms) for part in parts), centre, rms


def check_constant(channels: Sequence[str], centre: FloatArray, rms: FloatArray) -> None:
    """Refuse a channel that doesn't move."""
    for name, spread, middle in zip(channels, rms, centre, strict=True):
        if not spread > 4e-16 * abs(middle):
            raise InputError(
                f"channel '{name}' is constant ({middle:g}) over the record: nothing can be identified from or for "
                "it; leave it out or choose another stretch"
            )


def _parts(record: Record, channels: Sequence[str], weights: FloatArray | None) -> Iterator[Stretch]:
    """Yield the runs of samples whose weight isn't 0, as recorded."""
    rows = np.array(record.columns(channels), dtype=np.intp)
    as_recorded = Scaling(rows=rows, centre=np.zeros(len(rows)), rms=np.ones(len(rows)))
    edges = [0, len(record)] if weights is None else _edges(weights)
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        yield Stretch(
            values=record.values[start:stop].T,
            weights=None if weights is None else weights[start:stop],
            scaling=as_recorded,
        )


def _edges(weights: FloatArray) -> list[int]:
    """Return where runs of positive weights start and stop, in turn."""
    counts = np.concatenate([[False], weights > 0, [False]])
    return np.flatnonzero(np.diff(counts)).tolist()


def moments(values: FloatArray, weights: FloatArray | None = None) -> FloatArray:
    """Return each channel's sum of weights, weighted mean and sum of squares about it, shape (3, channels)."""
    if weights is None:
        total, mean = float(values.shape[1]), values.mean(axis=1)
    else:
        total = float(weights.sum())
        mean = values @ weights / total
    off = values - mean[:, np.newaxis]
    return np.stack([np.full(len(mean), total), mean, np.vecdot(off if weights is None else off * weights, off)])


def merged(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the moments of two sets of samples together; offsets and steps between them cost no digits."""
    total = first[0] + second[0]
    off = second[1] - first[1]
    share = second[0] / total
    return np.stack([total, first[1] + share * off, first[2] + second[2] + first[0] * share * off**2])


def _moments(parts: Sequence[Stretch]) -> tuple[FloatArray, FloatArray]:
    """Return the (weighted) means of all stretches and the RMS values about them."""
    chunks = [
        moments(part.recorded(start, start + CHUNK), None if weights is None else weights[start : start + CHUNK])
        for part, weights in ((part, part.weights) for part in parts)
        for start in range(0, len(part), CHUNK)
    ]
    total, mean, squares = reduce(merged, chunks)
    return mean, np.sqrt(squares / total)


def _refuse_missing(records: Sequence[Record], channels: Sequence[str], weights: Sequence[FloatArray | None]) -> None:
    """Say which channel misses how many of the samples that count, and where the first one is."""
    for record, own in zip(records, weights, strict=True):
        for name in channels:
            missing = ~np.isfinite(record[name])
            if own is not None:
                missing &= own > 0
            if missing.any():
                raise InputError(
                    f"channel '{name}' has {int(missing.sum())} missing samples, the first at "
                    f"{record.time_s[int(missing.argmax())]:g} s; identify on a stretch without, with record.between, "
                    "or give these samples a weight of 0"
                )
    raise InputError(
        f"values of {', '.join(dict.fromkeys(channels))} are too large to be squared; state them in another unit"
    )
