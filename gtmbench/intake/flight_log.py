"""What is taken in of a recorded flight: segments between gaps, remarks, and how columns are read, also in a file."""

from __future__ import annotations

import re
import shlex
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from gtmbench.checks import naming, one_line, shown
from gtmbench.errors import InputError
from gtmbench.files.writing import check_size, is_file, no_such, write_text
from gtmbench.intake.events import Event
from gtmbench.intake.imus import Imu
from gtmbench.intake.published_failures import Injection
from gtmbench.values.notebook import card
from gtmbench.values.ranges import OutOfRange
from gtmbench.values.record import Record, Span

_APART = 3  # of a kind and a channel stand for themselves
_SINCE = re.compile(r"times are since the first, ((?:\d{4}-\d\d-\d\d )?\d\d:\d\d:\d\d\.\d{3}(?: UTC)?)")


@dataclass(frozen=True, kw_only=True)
class Remark:
    """A note on a log that a reader should know.

    Attributes
    ----------
    kind : str
        ``gap``, ``clock jump``, ``out of order``, ``duplicate``, ``slipped``, ``held``, ``missing``, ``constant``,
        ``saturated``, ``short``, ``sign``, ``out of range``.
    channel : str or None
        The channel; None if it concerns all of them.
    start_s, end_s : float
        Its span, on the log's clock in seconds.
    text : str
        In words, with figures.

    Examples
    --------
    >>> import gtmbench as gb
    >>> gap = gb.Remark(kind="gap", channel=None, start_s=3.9, end_s=6.0, text="nothing from 3.90 to 6.00 s")
    >>> gap.end_s - gap.start_s
    2.1
    """

    kind: str
    channel: str | None
    start_s: float
    end_s: float
    text: str


@dataclass(frozen=True, kw_only=True)
class Unread:
    """A span of a log that is in no segment.

    Attributes
    ----------
    start_s, end_s : float
        On the log's clock in seconds.
    reason : str
        A short phrase: ``gap``, ``clock set back``, ``clock jump``, ``samples come at 25 Hz instead of 100``, ``too
        short between gaps``, ``attitude not logged yet``, ``gyros not logged any more``, ``margin of the resampling``.

    Examples
    --------
    >>> import gtmbench as gb
    >>> gap = gb.Unread(start_s=3.9, end_s=6.0, reason="gap")
    >>> gap.end_s - gap.start_s
    2.1
    """

    start_s: float
    end_s: float
    reason: str


@dataclass(frozen=True, kw_only=True)
class Source:
    """Which column of a log a channel is, and how it is read; of the channel ``time``, which column tells it."""

    channel: str
    column: str
    unit: str
    sign: float = 1.0  # -1 where it is read with its sign turned
    period_s: float | None = None  # how far apart its samples are, at the median, whatever the record's rate
    late_s: float = 0.0  # by how many seconds its stamps are late
    # what shows that it is this channel in this unit, where neither a name nor anybody says so; "" where one does
    guessed: str = ""

    @property
    def typed(self) -> str:
        """What stands behind its channel in ``--map``."""
        late = f"@{self.late_s:g}" if self.late_s else ""
        return f"{'-' if self.sign < 0 else ''}{self.column}{f':{self.unit}{late}' if self.unit else ''}"

    @property
    def option(self) -> str:
        """The option under which it is read so without a guess."""
        return f"--map {shlex.quote(f'{self.channel}={self.typed}')}"


@dataclass(frozen=True, kw_only=True, eq=False)
class FlightLog:
    """A recorded flight, ready to be watched.

    Attributes
    ----------
    path : Path
    segments : tuple of Record
        The stretches between gaps, in order of time, with one sample period and the same channels. Times are the log's.
        A channel is missing (NaN) while it pauses and others continue.
    remarks : tuple of Remark
        In time.
    method : tuple of str
        The treatment of the log, line by line: which column became which channel, how it was resampled.
    sources : tuple of Source
        The columns of the channels.
    events : tuple of Event
        The log's own events, in order of time. Only PX4's and ArduPilot's formats have them.
    injections : tuple of Injection
        The injected failures that the log records, in order of time.
    imus : tuple of Imu
        Its gyros of three axes, each sampled often enough to be compared.
    attitude_from_gyros : bool
        Whether its format documents that the gyros drive the attitude.
    is_received : bool
        Whether a radio received it, so that what is missing may be the link's loss and no sensor's.
    unread : tuple of Unread
        Every span of the log that is in no segment, and why, in time. The segments and these cover ``span_s`` without a
        hole that is longer than a sample.
    out_of_range : tuple of OutOfRange
        Which readings no sensor reads, a channel each: they are missing.
    zero_stamp : str
        What its own stamps read at 0 s, where they are dates or times of day or count from 1970: ``2026-05-04
        11:59:10.020``, with ``UTC`` behind it where that is known; "" where they count from when a logger was
        switched on.
    zero_utc : datetime64 or None
        That date, where it is UTC.
    periods_s : mapping
        How far apart each channel's samples are in the log, at the median, whatever the record's rate.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import gtmbench as gb
    >>> rows = [f"{0.1 * k:.1f},{k % 7}" for k in range(100) if not 40 <= k < 60]  # two seconds are missing
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(folder, "flight.csv").write_text(chr(10).join(["time_s,p_deg_s", *rows]))
    ...     log = gb.open_log(Path(folder, "flight.csv"))
    >>> log.channels, [len(segment) for segment in log.segments], log.remarks[0].kind
    (('p',), [40, 40], 'gap')
    >>> log.unread, log.span_s, log.periods_s
    ((Unread(start_s=3.9, end_s=6.0, reason='gap'),), (0.0, 9.9), {'p': 0.1})
    """

    path: Path
    segments: tuple[Record, ...] = field(repr=False)
    remarks: tuple[Remark, ...]
    method: tuple[str, ...]
    sources: tuple[Source, ...] = ()
    events: tuple[Event, ...] = ()
    injections: tuple[Injection, ...] = ()
    imus: tuple[Imu, ...] = ()
    attitude_from_gyros: bool = False
    is_received: bool = False
    unread: tuple[Unread, ...] = ()
    out_of_range: tuple[OutOfRange, ...] = ()
    periods_s: Mapping[str, float] = field(default_factory=dict, repr=False)

    def _repr_html_(self) -> str:
        facts = {
            "channels": ", ".join(self.channels),
            "every": f"{self.sample_period_s:g} s",
            "segments": ", ".join(f"{each.start_s:g} to {each.end_s:g} s" for each in self.segments[:_APART])
            + (f" and {len(self.segments) - _APART} more" if len(self.segments) > _APART else ""),
        }
        rows = [(f"{each.start_s:.2f}", each.kind, each.channel or "all", each.text) for each in self.remarks]
        return card(f"FlightLog {self.path.name}", facts, columns=("from (s)", "remark", "channel", "text"), rows=rows)

    @property
    def zero_stamp(self) -> str:
        """What its own stamps read at 0 s; "" where they are no dates or times of day."""
        told = next(filter(None, map(_SINCE.search, self.method)), None)  # every format's reader says it so
        return "" if told is None else told[1]

    @property
    def zero_utc(self) -> np.datetime64 | None:
        """When its clock reads 0 s; None where its stamps aren't known to be UTC."""
        date, utc, _ = self.zero_stamp.partition(" UTC")
        return np.datetime64(date, "ms") if utc and " " in date else None

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels that every segment has."""
        return self.segments[0].channels

    @property
    def sample_period_s(self) -> float:
        """Ts, in seconds."""
        return self.segments[0].sample_period_s

    @property
    def span_s(self) -> Span:
        """From the first sample of its channels in the file to the last, whether or not they are in a segment."""
        spans = [(each.start_s, each.end_s) for each in self.segments]
        spans += [(each.start_s, each.end_s) for each in self.unread]
        return min(start_s for start_s, _ in spans), max(end_s for _, end_s in spans)


def remark(kind: str, start_s: float, end_s: float, text: str, channel: str | None = None) -> Remark:
    """Return a remark on a channel, or on all of them; times may be numpy's."""
    return Remark(kind=kind, channel=channel, start_s=float(start_s), end_s=float(end_s), text=text)


def summed_up(remarks: Iterable[Remark]) -> tuple[Remark, ...]:
    """Return remarks in time, a few dozen at most.

    >>> gaps = [Remark(kind="gap", channel=None, start_s=t, end_s=t + 1, text=f"nothing from {t} s") for t in range(9)]
    >>> summed_up(gaps)[0].text
    '9 times from 0 to 9 s, in all 9 s; the first: nothing from 0 s'
    """
    plain = [replace(remark, text=one_line(remark.text)) for remark in remarks]
    ordered = sorted(plain, key=lambda remark: (remark.start_s, remark.end_s))
    one_by_one = _grouped(ordered, _APART, by_channel=True)
    return tuple(one_by_one if len(one_by_one) <= 36 else _grouped(ordered, 1, by_channel=False))


def _grouped(remarks: Sequence[Remark], apart: int, *, by_channel: bool) -> list[Remark]:
    groups: dict[tuple[str, str | None], list[Remark]] = {}
    for remark in remarks:
        groups.setdefault((remark.kind, remark.channel if by_channel else None), []).append(remark)
    summed = [remark for group in groups.values() for remark in (group if len(group) <= apart else [_sum(group)])]
    return sorted(summed, key=lambda remark: (remark.start_s, remark.end_s))


def _sum(group: Sequence[Remark]) -> Remark:
    start_s, end_s = group[0].start_s, max(remark.end_s for remark in group)
    in_all_s = sum(remark.end_s - remark.start_s for remark in group)
    channels = list(dict.fromkeys(remark.channel for remark in group if remark.channel))
    about = f" ({', '.join(channels[:12])})" if len(channels) > 1 else ""
    span = f"from {start_s:.10g} to {end_s:.10g} s, in all {in_all_s:.4g} s"
    text = f"{len(group)} times{about} {span}; the first: {group[0].text}"
    channel = channels[0] if len(channels) == 1 and group[0].channel else None
    return Remark(kind=group[0].kind, channel=channel, start_s=start_s, end_s=end_s, text=text)


_LARGEST_BYTES = 1 << 20  # more is no file that somebody wrote
_HEAD = "# CHANNEL = COLUMN:UNIT, as --map takes them; gtmbench monitor LOG --map {}"


def read_map_file(path: Path) -> list[str]:
    """Return a file's columns as texts ``CHANNEL=COLUMN:UNIT``."""
    if not is_file(path):
        raise InputError(no_such(path))
    check_size(path, "file of columns", _LARGEST_BYTES)
    with naming(path):
        try:
            columns = tomllib.loads(path.read_text(encoding="utf-8")).get("columns", {})
        except (ValueError, RecursionError) as error:
            raise InputError(f"it isn't TOML: {error}") from error
        wrong = (
            [name for name, text in columns.items() if not isinstance(text, str)] if isinstance(columns, dict) else []
        )
        if not isinstance(columns, dict) or not columns or wrong:
            raise InputError(
                f'it is {shown(columns)}; a file of columns has lines such as p = "gyro_x:rad/s" in [columns]'
            )
        return [f"{channel}={text}" for channel, text in columns.items()]


def write_map_file(sources: Iterable[Source], path: Path) -> None:
    """Write how columns are read, those that were guessed like those that are known.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_map_file([Source(channel="nz", column="az", unit="g", sign=-1.0)], Path(folder, "columns.toml"))
    ...     read_map_file(Path(folder, "columns.toml"))
    ['nz=-az:g']
    """
    import tomlkit

    columns = {source.channel: source.typed for source in sources if source.column}
    write_text(path, f"{_HEAD.format(path.name)}\n{tomlkit.dumps({'columns': columns})}")
