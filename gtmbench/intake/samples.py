"""A log's channels sample by sample, as they stand in its file, and the file with others in their place."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from gtmbench.checks import naming
from gtmbench.errors import InputError
from gtmbench.intake.formats.raw import Cells, IntArray
from gtmbench.intake.formats.registry import rewrite_raw
from gtmbench.intake.lattice import find_lattice
from gtmbench.intake.mapping import ChosenColumn, choose, split_mapping
from gtmbench.intake.read import ReadLog, read_log
from gtmbench.intake.stamps import Clock, cleaned, single
from gtmbench.intake.times import with_time
from gtmbench.values.channels import header_of
from gtmbench.values.clock import FloatArray
from gtmbench.values.ranges import OutOfRange
from gtmbench.values.record import Span


@dataclass(frozen=True, kw_only=True, eq=False)
class ChannelSamples:
    """A channel's samples that are there: rows without a number, or without a time, are none."""

    chosen: ChosenColumn = field(repr=False)  # the column, and how the channel is made of it
    rows: IntArray = field(repr=False)  # of the column, in order of time
    time_s: FloatArray  # when they are, on the clock that `open_log` gives a record
    values: FloatArray  # in the channel's unit
    span_s: Span  # when the column's clock begins and ends, whether its first and last cells hold a number or not
    out_of_range: OutOfRange | None = None  # the readings that no sensor reads: they are none of the samples

    @property
    def sample_period_s(self) -> float:
        """The nominal one: of the even clock behind the stamps, or their median step where there is none."""
        lattice = find_lattice([self.time_s])
        return float(np.median(np.diff(self.time_s))) if lattice is None else lattice.period_s

    def cells(self, values: FloatArray) -> Cells:
        """Return the cells that change with other values of the channel, in the column's own unit."""
        stored = self.chosen.series.values()[self.rows]
        is_new = (values != self.values) & ~(np.isnan(values) & np.isnan(self.values))
        new = values[is_new] / self.chosen.factor
        if self.chosen.channel == "psi":
            new = _turned_back(new, stored, abs(360.0 / self.chosen.factor))
        return Cells(column=self.chosen.series, rows=self.rows[is_new], values=new)


def log_samples(log: Path | ReadLog, channels: Sequence[str], mapping: Sequence[str] = ()) -> dict[str, ChannelSamples]:
    """Return channels of a log, found as `open_log` finds them, sample by sample."""
    columns = split_mapping(mapping)
    read = read_log(log)
    raw = read.raw
    with naming(read.path), np.errstate(all="ignore"):  # broken logs hold signalling NaNs and numbers that overflow
        raw = with_time(raw, columns.pop("time", None))
        chosen = choose(raw, columns, channels)
        clocks, breaks_s, _ = cleaned({each.series.clock: raw.clocks[each.series.clock] for each in chosen})
        found: dict[str, ChannelSamples] = {}
        for each in chosen:
            own = _samples(each, clocks[each.series.clock], breaks_s)
            found[each.channel] = _with_shared_times(own, found.values())
        return found


def _with_shared_times(own: ChannelSamples, others: Iterable[ChannelSamples]) -> ChannelSamples:
    """Return samples with another channel's times where they are the same: they take as much memory as values."""
    for other in others:
        if np.array_equal(other.time_s, own.time_s) and np.array_equal(other.rows, own.rows):
            return replace(own, rows=other.rows, time_s=other.time_s)
    return own


def _samples(chosen: ChosenColumn, clock: Clock, breaks_s: Sequence[float]) -> ChannelSamples:
    values, _, beyond = chosen.at(clock)
    rows = np.arange(len(values)) if isinstance(clock.rows, slice) else clock.rows
    there = np.flatnonzero(np.isfinite(values))
    if len(there) < 2:
        raise InputError(f"column '{chosen.series.name}' holds {len(there)} numbers; a channel has more")
    kept, time_s, _, _ = single("", clock.time_s[there], values[there, np.newaxis], breaks_s)
    return ChannelSamples(
        chosen=chosen,
        rows=rows[there[kept]],
        time_s=time_s - chosen.late_s if chosen.late_s else time_s,
        values=values[there[kept]],
        span_s=(float(clock.time_s[0]) - chosen.late_s, float(clock.time_s[-1]) - chosen.late_s),
        out_of_range=beyond,
    )


def write_samples(
    path: Path, out: Path, samples: Mapping[str, ChannelSamples], values: Mapping[str, FloatArray]
) -> None:
    """Write a log anew with other values of some channels, everything else as it is."""
    for channel in values:
        made_of = samples[channel].chosen.series.made_of
        if made_of:
            raise InputError(
                f"{path}: {channel} is worked out of {', '.join(made_of)}; only a column can be written anew"
            )
    rewrite_raw(path, out, [samples[channel].cells(new) for channel, new in values.items()])


def write_table(out: Path, samples: Mapping[str, ChannelSamples], values: Mapping[str, FloatArray]) -> None:
    """Write channels as a CSV of our own headers: a row a time, empty where a channel has no sample then."""
    times = np.unique(np.concatenate([each.time_s for each in samples.values()]))
    columns = [np.full(len(times), np.nan) for _ in samples]
    for column, (channel, each) in zip(columns, samples.items(), strict=True):
        column[np.searchsorted(times, each.time_s)] = values[channel]
    with out.open("w", encoding="utf-8") as file:
        file.write(",".join(["time_s", *map(header_of, samples)]) + "\n")
        for row in zip(times.tolist(), *(column.tolist() for column in columns), strict=True):
            file.write(",".join("" if math.isnan(value) else repr(value) for value in row) + "\n")


def _turned_back(angles: FloatArray, stored: FloatArray, turn: float) -> FloatArray:
    """Return headings within the turn that a column keeps to: 0 to 360 deg, +-180 deg, or any."""
    low, high = float(stored.min()), float(stored.max())
    for start in (-0.5 * turn, 0.0):
        if start <= low and high <= start + turn:
            outside = (angles < start) | (angles > start + turn)
            return np.where(outside, start + np.mod(angles - start, turn), angles)
    return angles
