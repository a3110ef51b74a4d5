"""Threads of OpenBLAS, NumPy's and SciPy's library of matrix products: one, unless somebody asks for more.

Our products are many and small. OpenBLAS shares each among all cores and waits for the last of them: on two busy cores
a diagnosis took twice as long, and products of an operator forty times. Processes (`--jobs`) use the cores better.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

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
