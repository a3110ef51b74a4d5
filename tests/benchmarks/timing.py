"""Time and memory of a call. No import of gtmbench: peers in environments of their own are measured with it, too."""

from __future__ import annotations

import ctypes
import gc
import statistics
import time
from collections.abc import Callable, Mapping
from pathlib import Path

Work = Callable[[], object]
Times = dict[str, list[float]]
LEAST_S = 0.02
MMAP_THRESHOLD, TRIM_THRESHOLD = -3, -1  # glibc's numbers of what mallopt sets


def seconds(work: Work) -> float:
    """Time a call: the mean over as many as fill 20 ms."""
    calls, start = 0, time.perf_counter()
    while True:
        work()
        calls += 1
        spent = time.perf_counter() - start
        if spent >= LEAST_S:
            return spent / calls


def interleaved(works: Mapping[str, Work], rounds: int) -> Times:
    """Time all works in turn, round after round: a machine that slows down slows down every one of them."""
    times: Times = {name: [] for name in works}
    for _ in range(rounds):
        for name, work in works.items():
            times[name].append(seconds(work))
    return times


def ratio(times: Times, over: str, under: str) -> float:
    """Return the median over the rounds of one work's time over another's."""
    return statistics.median(a / b for a, b in zip(times[over], times[under], strict=True))


def peak_memory(work: Work) -> int:
    """Return by how many bytes a call makes the process grow at its peak, in resident pages.

    Resident pages, for tracemalloc doesn't see what LAPACK's wrappers in numpy and scipy allocate: of the 85 MB that
    ``numpy.linalg.lstsq`` takes for the main job, half. Linux only. Warm up before: what a library keeps for good is
    not the call's.
    """
    glibc = ctypes.CDLL(None)
    glibc.mallopt(MMAP_THRESHOLD, 1 << 16)  # every array gets pages of its own: none that were kept or are huge
    gc.collect()
    glibc.malloc_trim(0)
    Path("/proc/self/clear_refs").write_text("5")  # the peak starts anew from here
    before = status_bytes("VmRSS")
    kept = work()
    grown = status_bytes("VmHWM") - before
    del kept
    glibc.mallopt(MMAP_THRESHOLD, 1 << 25)  # what a process that handles large arrays comes to by itself
    glibc.mallopt(TRIM_THRESHOLD, 1 << 26)
    return max(grown, 0)


def status_bytes(key: str) -> int:
    """Return a size of this process: ``VmHWM`` is its peak (what `getrusage` tells is its parent's, where higher)."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(key))
