"""What work may take: threads of OpenBLAS, one unless somebody asks for more, and time by the clock."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from gtmbench.checks import number
from gtmbench.errors import GtmbenchError

# Our products are many and small, and OpenBLAS shares each among all cores and waits for the last: on two busy cores
# a diagnosis took twice as long, and products of an operator forty times. Processes (`--jobs`) use the cores better.
_THREADS = "OPENBLAS_NUM_THREADS"


def one_thread() -> None:
    """Let OpenBLAS use one thread in this process, if NumPy isn't loaded yet, and in those that it starts."""
    os.environ.setdefault(_THREADS, "1")


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Let it use one in the processes that start meanwhile."""
    asked = os.environ.get(_THREADS)
    one_thread()
    try:
        yield
    finally:
        if asked is None:
            os.environ.pop(_THREADS, None)


class _TimeIsUpError(BaseException):
    """No reader's ``except Exception`` keeps it."""


@contextmanager
def limited(seconds: float | None) -> Iterator[None]:
    """End the work of a block after so many seconds; outside of a main thread, or without an alarm clock, never.

    `seconds`: without a number there is no limit. Raises GtmbenchError where it wasn't done in time.

    >>> with limited(0.01):
    ...     threading.Event().wait()
    Traceback (most recent call last):
    gtmbench.errors.GtmbenchError: not done within 0.01 s; cut the log, or allow more with --time-limit
    """
    limit_s = 0.0 if seconds is None else number("--time-limit", seconds, 0.0, 1e6, above=True)
    if not limit_s or threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
        yield
        return

    def ring(*_: object) -> None:
        raise _TimeIsUpError

    former = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, limit_s)
    try:
        yield
    except _TimeIsUpError:
        raise GtmbenchError(f"not done within {limit_s:g} s; cut the log, or allow more with --time-limit") from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, former)
