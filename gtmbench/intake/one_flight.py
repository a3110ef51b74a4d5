"""Whether tables that are called by sensors are one flight's: nothing in them may show that they are two logs.

They are several logs where the same sensor is in two of them, or where their times don't overlap: one recorder holds a
sensor once, and begins and ends all of its tables together. An autopilot's tables are judged by their names, which its
exporter gives them (`gtmbench.intake.formats.folder`): several of its topics may hold the same channel.
"""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from pathlib import Path

import numpy as np

from gtmbench.checks import one_line
from gtmbench.errors import InputError
from gtmbench.intake.formats import registry
from gtmbench.intake.formats.folder import TABLES, is_folder_of_tables, tables_in
from gtmbench.intake.formats.raw import RawLog
from gtmbench.intake.mapping import judged
from gtmbench.intake.names import stated_unit, triples
from gtmbench.intake.quaternions import with_quaternions
from gtmbench.intake.times import main_span, with_time
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, GYROS, SENSORS
from gtmbench.values.record import Span

_TOGETHER = 0.5  # of the shorter of two tables; chosen: those of one recorder begin and end together
_OTHER_SENSOR = re.compile(r"gps|gnss|mag|compass")  # its heading isn't the attitude's
_KIND = re.compile(r"gyr|linear|acc|mag|imu|ahrs|att|orient|euler|baro|press|gps|gnss|air|pitot")
_AXES = {"rate": GYROS, "angle": ATTITUDE, "acceleration": ACCELEROMETERS}
_MOST_KEPT = 512  # folders


@dataclass(frozen=True, kw_only=True)
class _Table:
    """What a table holds."""

    name: str
    channels: frozenset[str]  # the sensors that its columns look like, whether or not their units are known
    columns: frozenset[str]  # the bare names of its columns, the time's left out
    span_s: Span | None  # when it runs, on a clock that its log's tables share; None where no column tells the time

    @property
    def kind(self) -> str:
        """The sensor by which it is called, "" where its name says none."""
        named = _KIND.search(self.name.lower())
        return named[0] if named else ""


def is_log_folder(path: Path) -> bool:
    """Tell whether a folder is one log: by its names, and by what its tables hold.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(folder, "failed.csv").write_text("time_s,p_deg_s" + chr(10) + "0,1.0" + chr(10) + "1,2.0")
    ...     _ = Path(folder, "gyros.csv").write_text("time_s,gx_rad_s" + chr(10) + "0,1.0" + chr(10) + "1,2.0")
    ...     is_log_folder(Path(folder)), why_several_in(Path(folder))
    (False, 'failed and gyros both hold p')
    """
    return registry.is_log_folder(path) and not why_several_in(path)


def why_several_in(path: Path) -> str:
    """Return what shows that a folder's tables are several logs; "" where nothing does, or it can't be read."""
    try:
        if not is_folder_of_tables(path):
            return ""
        files = [(str(each), each.stat().st_size, each.stat().st_mtime_ns) for each in tables_in(path)]
    except OSError:
        return ""
    return _why_several_of(path, tuple(sorted(files)))


@lru_cache(maxsize=_MOST_KEPT)
def _why_several_of(path: Path, _files: tuple[tuple[str, int, int], ...]) -> str:
    """Read a folder's tables once, for as long as its files stay as they are."""
    try:
        return why_several(registry.read_raw(path))
    except InputError:  # whoever opens it is told
        return ""


def why_several(raw: RawLog) -> str:
    """Return what shows that the tables of a log are several logs, in a few words; "" where nothing does."""
    if not raw.kind.endswith(TABLES):
        return ""
    with np.errstate(all="ignore"):
        tables = _tables_of(with_quaternions(raw))
    reasons = (_why_apart(one, other) for one, other in combinations(tables, 2))
    return next((one_line(reason) for reason in reasons if reason), "")


def _tables_of(raw: RawLog) -> list[_Table]:
    timed = raw
    with suppress(InputError):  # no table tells its time
        timed = with_time(raw, None)
    channels: dict[str, set[str]] = {series.clock: set() for series in raw.series}
    columns: dict[str, set[str]] = {name: set() for name in channels}
    unknown = []
    for series in raw.series:
        channel = judged(series, raw).channel
        own = {channel} & _measured_once(series.clock)
        channels[series.clock] |= {f"{each} (quaternion)" for each in own} if series.made_of else own
        unknown += [] if channel else [series]
        if channel != "time":
            columns[series.clock].add(stated_unit(series.name.removeprefix(f"{series.clock}."))[0].lower())
    for triple in triples([series for series in unknown if not series.made_of]):
        channels[triple.clock] |= {*_AXES[triple.kind]} & _measured_once(triple.clock)
    return [
        _Table(
            name=name, channels=frozenset(channels[name]), columns=frozenset(columns[name]), span_s=_span_s(timed, name)
        )
        for name in channels
    ]


def _measured_once(name: str) -> set[str]:
    """Return the channels that show which log a table is of: a flight has one sensor of each."""
    others = ["psi"] if _OTHER_SENSOR.search(name.lower()) else []
    others += ACCELEROMETERS if "linear" in name.lower() else ()  # a phone's, worked out: without gravity
    return {*SENSORS} - {"altitude", *others}


def _span_s(timed: RawLog, name: str) -> Span | None:
    stamps = timed.clocks.get(name, np.zeros(0))
    known = stamps[np.isfinite(stamps)]
    return main_span(known) if len(known) else None


def _why_apart(one: _Table, other: _Table) -> str:
    """Return what shows that two tables are of two logs, "" where nothing does."""
    both = one.channels & other.channels
    if both:
        return f"{one.name} and {other.name} both hold {_listed(both)}"
    if one.kind and one.kind == other.kind and _is_part(one.columns, other.columns):
        return f"{one.name} and {other.name} are both called {one.kind} and have the same columns"
    if not (one.channels and other.channels and one.span_s and other.span_s):
        return ""
    together_s = min(one.span_s[1], other.span_s[1]) - max(one.span_s[0], other.span_s[0])
    shorter_s = min(end_s - start_s for start_s, end_s in (one.span_s, other.span_s))
    if 0.0 <= together_s >= _TOGETHER * shorter_s:
        return ""
    told = [
        f"{table.name} runs from {table.span_s[0]:.10g} to {table.span_s[1]:.10g} s"
        for table in (one, other)
        if table.span_s
    ]
    return f"{' and '.join(told)}: their clocks don't agree, or they were recorded one after the other"


def _is_part(one: frozenset[str], other: frozenset[str]) -> bool:
    return bool(one and other) and (one <= other or other <= one)


def _listed(channels: frozenset[str]) -> str:
    return ", ".join(sorted(channels, key=lambda name: SENSORS.index(name.split()[0])))
