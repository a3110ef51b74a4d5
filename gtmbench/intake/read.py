"""A log's file as it was read: once, for whoever opens it, for whatever channels and at whatever rate."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gtmbench.errors import InputError
from gtmbench.intake.formats.dialects import dialects
from gtmbench.intake.formats.raw import RawLog
from gtmbench.intake.formats.registry import read_raw, split_part
from gtmbench.intake.one_flight import why_several
from gtmbench.intake.physics import tells_of_one_motion
from gtmbench.intake.quaternions import with_quaternions
from gtmbench.intake.times import with_time


@dataclass(frozen=True, kw_only=True, eq=False)
class ReadLog:
    """What was read of a log's file."""

    path: Path
    # Its columns, attitudes of quaternions among them. What a format loads column by column is loaded when it is
    # asked for.
    raw: RawLog = field(repr=False)


def read_log(log: str | Path | ReadLog) -> ReadLog:
    """Read a log's file; what was read before is returned as it is.

    Raises an InputError where it isn't a file, is too large, isn't of a known format, or is broken; or holds tables of
    several logs.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(folder, "log.csv").write_text("time_s,p_deg_s" + chr(10) + "0,1.0" + chr(10) + "1,2.0")
    ...     read = read_log(Path(folder, "log.csv"))
    >>> [series.name for series in read.raw.series], read_log(read) is read
    (['time_s', 'p_deg_s'], True)
    """
    if isinstance(log, ReadLog):
        return log
    path, part = split_part(log)
    raw = read_raw(path, part)
    if why := why_several(raw):
        raise InputError(f"{path} holds the tables of several logs, for {why}; give its tables one by one")
    return ReadLog(path=path, raw=with_quaternions(_by_its_width(raw)))


def _by_its_width(raw: RawLog) -> RawLog:
    """Return a table without a header as a known source writes one as wide, where gyros and attitude agree."""
    for dialect in dialects():
        if raw.is_nameless and dialect.found_in(raw):
            told = dialect.told_of(raw)
            with suppress(InputError), np.errstate(all="ignore"):
                if tells_of_one_motion(with_time(told, None)):
                    return told
    return raw
