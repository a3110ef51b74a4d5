"""Recordings read back as one table, and shown by the rerun viewer, which listens on this machine only."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from threading import Event, Timer
from typing import TYPE_CHECKING

from gtmbench.checks import listed, shown
from gtmbench.errors import GtmbenchError, InputError
from gtmbench.files.writing import LOGS, check_size, is_file, no_such

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

_READER = Path(__file__).with_name("arrow_rows.py")
_LONGEST_S = 300.0  # beside 1 s for 1 MB: it takes a second for 70 MB, and a busy machine may be slow


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
    >>> from gtmbench.report.recording.entities import Recording
    >>> with TemporaryDirectory() as folder:
    ...     with rr.RecordingStream("gtmbench") as stream:
    ...         stream.save(f"{folder}/study.rrd")
    ...         found = {"detected": True, "alarm_time_s": 301.25}
    ...         Recording(stream=stream).log_verdict("/trials/drift/p/verdict", found)
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
    check_size(path, "recording", 1 << 31)  # what fits into memory
    command = [sys.executable, "-P", str(_READER), str(path.absolute()), *what]
    longest_s = _LONGEST_S + path.stat().st_size / 1e6
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


_PORT = 9876  # rerun's own
_OPENS_S = 20.0  # that a viewer may take
_MEMORY = "25%"  # of what it keeps of a flight that goes on: the oldest is dropped


def viewer_command(options: Sequence[str]) -> list[str]:
    """Return the command line of a viewer."""
    return _rerun(*options, "--bind", "127.0.0.1")


def without_analytics() -> str:
    """Turn off that rerun sends statistics of its use, for this user, and return what there is to say of it."""
    with suppress(OSError, subprocess.TimeoutExpired):
        ended = subprocess.run(_rerun("analytics", "disable"), capture_output=True, timeout=_OPENS_S, check=False)
        if ended.returncode == 0:
            return "rerun sends no usage statistics: they are turned off (rerun analytics enable: on again)"
    return "rerun's usage statistics couldn't be turned off; try: rerun analytics disable"


def _rerun(*options: str) -> list[str]:
    """Return a command line of rerun: ``python -m rerun_cli`` ends with code 0 whatever happened."""
    return [sys.executable, "-c", "import sys; from rerun_cli.__main__ import main; sys.exit(main())", *options]


def opened_viewer() -> str:
    """Return where a viewer takes recordings: the one that is open, or else a new one, which outlives this process."""
    address = f"rerun+http://127.0.0.1:{_PORT}/proxy"
    if _listens():
        return address
    without_analytics()
    command = viewer_command(["--port", str(_PORT), "--memory-limit", _MEMORY, "--hide-welcome-screen"])
    quiet = subprocess.DEVNULL
    viewer = subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet, start_new_session=True)
    until_s = time.monotonic() + _OPENS_S
    while not _listens():
        if viewer.poll() is not None or time.monotonic() > until_s:
            viewer.kill()
            raise GtmbenchError("the rerun viewer doesn't open; --record FILE.rrd does without it")
        time.sleep(0.1)
    return address


def _listens() -> bool:
    with suppress(OSError), socket.create_connection(("127.0.0.1", _PORT), timeout=1.0):
        return True
    return False
