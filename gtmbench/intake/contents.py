"""What a log's file holds: columns, channels, IMUs, what is of no use; channels sample by sample, also to rewrite."""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from gtmbench.checks import naming
from gtmbench.errors import InputError
from gtmbench.intake.events import Event
from gtmbench.intake.formats.raw import Cells, IntArray, RawLog, RawSeries
from gtmbench.intake.formats.registry import rewrite_raw
from gtmbench.intake.fresh_samples import tracks_of
from gtmbench.intake.lattice import find_lattice
from gtmbench.intake.mapping import ChosenColumn, choose, choose_of, judged, of_words, split_mapping
from gtmbench.intake.names import guess, stated_unit
from gtmbench.intake.read import ReadLog, read_log
from gtmbench.intake.stamps import Clock, cleaned, single
from gtmbench.intake.times import of_no_use, with_time
from gtmbench.intake.tracks import Track
from gtmbench.values.channels import ATTITUDE, CHANNELS, GYROS, header_of
from gtmbench.values.clock import FloatArray
from gtmbench.values.ranges import OutOfRange
from gtmbench.values.record import Span

_IMU = re.compile(r"(?P<topic>(IMU|GYR)\d?(#\d+)?|sensor_gyro(#\d+)?|vehicle_imu(#\d+)?|sensor_combined(#\d+)?)\..+")


@dataclass(frozen=True, kw_only=True)
class LogColumn:
    """A column of a log.

    Attributes
    ----------
    name : str
    unit : str
        As stated; "" if it isn't.
    channel : str
        The channel that it becomes, by its name or as mapped; ``time`` for the time; "" for none.
    why_not : str
        Why a column that looks like a channel isn't one.
    samples : int
    rate_hz, start_s, end_s : float
        Rate and span of its stamps; NaN if the time isn't known.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import gtmbench as gb
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(folder, "flight.csv").write_text(chr(10).join(["time_s,GyrX (deg/s),note", "0,1.0,a", "1,2.0,b"]))
    ...     columns = gb.log_columns(Path(folder, "flight.csv"))
    >>> [(column.name, column.unit, column.channel) for column in columns]
    [('time_s', 's', 'time'), ('GyrX (deg/s)', 'deg/s', 'p')]
    """

    name: str
    unit: str
    channel: str
    why_not: str
    samples: int
    rate_hz: float
    start_s: float
    end_s: float


@dataclass(frozen=True, kw_only=True)
class LogChannel:
    """A channel that a log has."""

    name: str
    column: str
    unit: str  # the column's
    samples: int  # that are there
    logged_hz: float  # logged_hz, fresh_hz: how often it is logged, and how often it is new; NaN where nothing tells
    fresh_hz: float
    why_not: str = ""  # why it can't be used; "" where it can
    # what shows that it is this channel in this unit, where nothing states it; "" where something does
    guessed: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class LogContents:
    """What a log holds."""

    path: Path
    kind: str  # the format
    span_s: Span | None  # of the channels that can be used, on the log's clock; None without any
    notes: tuple[str, ...]  # what a reader should know about its times and units
    columns: tuple[LogColumn, ...]
    channels: tuple[LogChannel, ...]  # those of the channel table
    imus: tuple[str, ...]  # the topics that hold gyros
    # whether its attitude is that of an estimator which the gyros drive: known of PX4's and ArduPilot's
    attitude_from_gyros: bool
    events: tuple[Event, ...] = ()  # on the log's clock, as they stand there
    no_time: str = ""  # why the time isn't known; "" where it is

    @property
    def usable(self) -> tuple[str, ...]:
        """The channels that can be brought to one clock."""
        return tuple(channel.name for channel in self.channels if not channel.why_not)


def log_contents(path: str | Path | ReadLog, *, mapping: Sequence[str] = ()) -> LogContents:
    r"""Return what a log's file holds, and what of it is of use: nothing is resampled, one bad column spoils nothing.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "log.csv")
    ...     _ = path.write_text("t [ms],gyro_x (rad/s)\n" + "".join(f"{10 * k},{k % 7}\n" for k in range(500)))
    ...     contents = log_contents(path)
    >>> contents.usable, round(contents.channels[0].fresh_hz, 6), contents.span_s
    (('p',), 100.0, (0.0, 4.99))
    """
    mapped = split_mapping(mapping)
    read = read_log(path)
    path, raw = read.path, read.raw
    with naming(path), np.errstate(all="ignore"):  # broken logs hold signalling NaNs and numbers that overflow
        of_time, no_time, timed = mapped.pop("time", None), "", raw
        try:
            timed = with_time(raw, of_time)
        except InputError as error:
            if of_time is not None:
                raise
            no_time = str(error)
        chosen = choose_of(list(CHANNELS), timed, mapped)
        channels, span_s = _channels(chosen, timed)
        by_column = {choice.series.name: choice.channel for choice in chosen}
        by_column |= dict.fromkeys(timed.time[0].split(" + ") if timed.time else (), "time")
        own_attitude = not set(ATTITUDE) <= set(mapped)  # what somebody maps is anybody's
        return LogContents(
            path=path,
            kind=raw.kind,
            span_s=span_s,
            notes=timed.notes,
            columns=_columns(timed, raw, by_column),
            channels=channels,
            imus=_imus(raw),
            attitude_from_gyros=raw.attitude_from_gyros and own_attitude,
            events=tuple(raw.events()) if of_time is None else (),
            no_time=no_time,
        )


def _channels(chosen: Sequence[ChosenColumn], raw: RawLog) -> tuple[tuple[LogChannel, ...], Span | None]:
    """Return what there is to say of channels, one clock at a time, and from when until when those of use run."""
    no_use = of_no_use(chosen, raw)
    told, spans = [], []
    tracks: dict[str, Track] = {}
    for clock in dict.fromkeys(choice.series.clock for choice in chosen if choice.series.clock in raw.clocks):
        own = [choice for choice in chosen if choice.series.clock == clock]
        try:
            clocks, breaks_s, _ = cleaned({clock: raw.clocks[clock]})
            made = tracks_of(own, clocks, breaks_s)[0]
        except InputError as error:
            no_use = {**{choice.channel: str(error) for choice in own}, **no_use}
            made = []
        tracks |= {name: track for track in made for name in track.channels}
    for choice in chosen:
        track = tracks.get(choice.channel)
        there = int(np.count_nonzero(np.isfinite(choice.series.values())))
        period_s = track.period_s if track is not None and len(track.time_s) > 1 else 0.0
        fresh_hz = 1.0 / period_s if period_s > 0.0 else np.nan  # a GPS without a fix stamps 0
        logged_hz = 1.0 / track.logged_s if track is not None and track.logged_s else fresh_hz
        told.append(
            LogChannel(
                name=choice.channel,
                column=choice.series.name,
                unit=choice.source.unit,
                samples=there,
                logged_hz=logged_hz,
                fresh_hz=fresh_hz,
                why_not=no_use.get(choice.channel, "" if raw.clocks else "no time"),
                guessed=choice.source.guessed,
            )
        )
        if track is not None and not told[-1].why_not:
            spans.append((float(track.time_s[0]), float(track.time_s[-1])))
    span_s = (min(start_s for start_s, _ in spans), max(end_s for _, end_s in spans)) if spans else None
    return tuple(told), span_s


def _imus(raw: RawLog) -> tuple[str, ...]:
    """Return the topics that hold gyros, in order."""
    topics = [named["topic"] for series in raw.series if (named := _IMU.fullmatch(series.name))]
    if not topics:  # a table's columns, or a container's that nobody documented
        guessed = [(series, guess(series.name, series.unit).channel) for series in raw.series]
        topics = [series.clock or "table" for series, channel in guessed if channel in GYROS]
    return tuple(sorted(set(topics)))


def log_columns(path: str | Path | ReadLog) -> tuple[LogColumn, ...]:
    """Return the columns of a log's file, with units, rates and the channels that they become.

    Parameters
    ----------
    path : str, Path or ReadLog
        CSV, Parquet, PX4 ULog, ArduPilot DataFlash or MCAP.

    Raises
    ------
    InputError
        If the file can't be read.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import gtmbench as gb
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(folder, "flight.csv").write_text(chr(10).join(["time_s,p_rad_s,flaps", "0,0.1,5", "1,0.2,5"]))
    ...     columns = gb.log_columns(Path(folder, "flight.csv"))
    >>> {column.name: column.channel for column in columns}
    {'time_s': 'time', 'p_rad_s': 'p', 'flaps': ''}
    """
    raw = timed = read_log(path).raw
    with np.errstate(all="ignore"):
        with contextlib.suppress(InputError):  # no column tells the time: the list says what might
            timed = with_time(raw, None)
        return _columns(timed, raw, {})


def _columns(timed: RawLog, raw: RawLog, by_column: Mapping[str, str]) -> tuple[LogColumn, ...]:
    """Return the columns of numbers, and those of text that are named as channels."""
    none = LogColumn(name="", unit="", channel="", why_not="", samples=0, rate_hz=np.nan, start_s=np.nan, end_s=np.nan)
    words = (replace(none, name=name, why_not=why) for name, why in of_words(raw).items())
    return (*(_column(series, timed, by_column) for series in raw.series), *words)


def _column(series: RawSeries, raw: RawLog, by_column: Mapping[str, str]) -> LogColumn:
    told = judged(series, raw)
    stamps = raw.clocks.get(series.clock)
    time_s = np.zeros(0) if stamps is None else stamps[np.isfinite(stamps)]
    steps = np.diff(time_s)
    forward = steps[steps > 0]
    channel = by_column.get(series.name, told.channel if told.meaning else "")
    return LogColumn(
        name=series.name,
        unit=series.meaning.unit if series.meaning else stated_unit(series.name, series.unit)[1],
        channel=channel,
        why_not="" if channel else told.why_not,
        samples=len(series.load() if stamps is None else stamps),
        rate_hz=1.0 / float(np.median(forward)) if len(forward) else np.nan,
        start_s=float(time_s[0]) if len(time_s) else np.nan,
        end_s=float(time_s[-1]) if len(time_s) else np.nan,
    )


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
