"""Recordings read back: what the viewer shows, and the verdicts, as one table."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from threading import Event, Timer
from typing import TYPE_CHECKING

from gtmbench.checks import listed, shown
from gtmbench.errors import InputError
from gtmbench.files.disk import LOGS, check_size, is_file, no_such

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

_READER = Path(__file__).with_name("arrow_rows.py")
_LARGEST_BYTES = 1 << 31
_LONGEST_S, _BYTES_PER_S = 300.0, 1e6  # it takes a second for 70 MB, and a busy machine may be slow


def read_recording(path: str | Path) -> pd.DataFrame:
    """Return a recording as one long table, a row a sample, with the study's values bit for bit.

    ==========  ======================================================================================
    column      holds
    ==========  ======================================================================================
    ``entity``  where it stands: ``/trials/drift/p/norm``, ``/threshold``, ``/events``, ...
    ``series``  the channel, where it is a channel's; otherwise the entity's last word; of events the level
                (``INFO``, ``WARN``, ...); of verdicts the field (``alarm_time_s``, ``severity.slope``)
    ``time_s``  to the nanosecond; NaN where there is none: verdicts, and the operator
    ``value``   a double. Samples that are missing have no row; True is 1
    ``text``    words: of events and verdicts; the lag of a Markov parameter
    ==========  ======================================================================================

    A field of a verdict that is None has neither value nor text; one that is a NaN has the text ``nan``. Entities
    stand in alphabetical order, rows in that of time. Words are categories: a study of 15 trials takes 80 MB.

    Parameters
    ----------
    path : str or Path
        An ``.rrd`` of gtmbench.

    Raises
    ------
    InputError
        If it isn't a whole recording, or another application's.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> import rerun as rr
    >>> import gtmbench as gb
    >>> from gtmbench.report.recording.entities import log_verdict
    >>> with TemporaryDirectory() as folder:
    ...     with rr.RecordingStream("gtmbench") as recording:
    ...         recording.save(f"{folder}/study.rrd")
    ...         log_verdict(recording, "/trials/drift/p/verdict", {"detected": True, "alarm_time_s": 301.25})
    ...     frame = gb.read_recording(f"{folder}/study.rrd")
    >>> verdict = frame[frame.entity == "/trials/drift/p/verdict"].set_index("series")
    >>> float(verdict.value["alarm_time_s"])
    301.25
    """
    table = _table_of(Path(path), "rows")
    application = str(table.schema.metadata[b"application"].decode(errors="replace"))
    if application != "gtmbench":
        raise InputError(f"{path} is a recording of {shown(application)}; give one that `gtmbench run` has written")
    return table.unify_dictionaries().to_pandas()


def recording_in(given: Path) -> Path:
    """Return the recording that is meant: the file, or the one in a folder."""
    if not given.is_dir():
        return given
    there = sorted(given.glob("*.rrd"))
    if len(there) == 1:
        return there[0]
    if not there:
        raise InputError(f"{given} is a folder without a recording (.rrd); `gtmbench run` writes one")
    raise InputError(f"{given} is a folder of {len(there)} recordings; give one: {listed(map(str, there[:5]), 'or')}")


def check_recording(path: Path) -> None:
    """Refuse what isn't a recording, or only the beginning of one: the viewer would open an empty window."""
    _table_of(path)


def _table_of(path: Path, *what: str) -> pa.Table:
    """Return what `arrow_rows.py` makes of a file, in a process of its own: rerun's reader may end it."""
    if not is_file(path):
        raise InputError(no_such(path, "`gtmbench run` writes one"))
    if path.suffix.lower() in LOGS:
        raise InputError(f"{path} is no recording but, by its name, a log; watch it: gtmbench monitor {path}")
    check_size(path, "recording", _LARGEST_BYTES)
    command = [sys.executable, "-P", str(_READER), str(path.absolute()), *what]
    longest_s = _LONGEST_S + path.stat().st_size / _BYTES_PER_S
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as reader:
        late = Event()

        def end() -> None:
            late.set()
            reader.kill()

        watchdog = Timer(longest_s, end)
        watchdog.start()
        try:
            table = _table(reader)
        finally:
            watchdog.cancel()
            reader.kill()
    if table is None and late.is_set():
        raise InputError(f"{path} wasn't read within {longest_s:.0f} s: the machine is busy, or the file is damaged")
    if table is None:
        raise InputError(f"{path} isn't a whole rerun recording; write it again with `gtmbench run`")
    return table


def _table(reader: subprocess.Popen[bytes]) -> pa.Table | None:
    """Return what a process writes, None where it doesn't end well."""
    import pyarrow as pa

    try:
        with pa.ipc.open_stream(reader.stdout) as stream:
            table = stream.read_all()
    except (pa.ArrowInvalid, OSError):  # it wrote nothing, or half of it
        return None
    return table if reader.wait() == 0 else None
