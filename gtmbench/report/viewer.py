"""The rerun viewer as a program that is started. It listens on this machine only: rerun would on every interface."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress

from gtmbench.errors import GtmbenchError

_PORT = 9876  # rerun's own
_OPENS_S = 20.0
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
