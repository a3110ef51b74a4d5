"""One thread for OpenBLAS, which shares each of our many small products among all cores and waits for the last.

On two busy cores a diagnosis took twice as long, and products of an operator forty times. Processes (`--jobs`) use the
cores better.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, wraps
from typing import TYPE_CHECKING, ParamSpec, TypeVar

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

_THREADS = "OPENBLAS_NUM_THREADS"
_Given = ParamSpec("_Given")
_Found = TypeVar("_Found")


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


def on_one_thread(function: Callable[_Given, _Found]) -> Callable[_Given, _Found]:
    """Return a function during which it uses one in this process: who calls from Python has loaded NumPy already.

    Whoever has set ``OPENBLAS_NUM_THREADS`` has said what is used.
    """

    @wraps(function)
    def limited(*args: _Given.args, **kwargs: _Given.kwargs) -> _Found:
        if _THREADS in os.environ:  # as in a call within
            return function(*args, **kwargs)
        with one_thread_each(), _libraries("scipy.linalg" in sys.modules).limit(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited


@cache
def _libraries(_is_scipy_loaded: bool) -> ThreadpoolController:
    """Return the loaded libraries that have threads; to look for them takes as long as to identify an operator."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
