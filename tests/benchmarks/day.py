"""A day's log at 100 Hz, watched by a ready monitor: how much faster than it was flown, and what memory that takes.

One hour and six are watched, each in a process of its own; an hour more costs a fifth of what these differ by, so a day
is the one and 23 of those. Seconds are of CPU, on one core. Memory is scaled from processes of its own, whose arrays of
a megabyte and more have pages of their own, as those of a day have: of the short ones malloc would keep what is freed.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import gtmbench as gb
from gtmbench.files.logs import write_log

from .timing import status_bytes

ROOT = Path(__file__).parent.parent.parent
HOURS, DAY = (1, 6), 24
PAGES_OF_THEIR_OWN = {"MALLOC_MMAP_THRESHOLD_": str(1 << 20)}
CHANNELS = ("p", "q", "r", "phi", "theta", "psi")


def measure(rounds: int) -> dict:
    """Return a day over the time that it takes, all of it and the watch alone, and the peak memory in GB."""
    with tempfile.TemporaryDirectory() as folder:
        monitor = Path(folder, "ready.json")
        gb.save_monitor(_ready(), monitor)
        logs = [Path(folder, f"{hours}.parquet") for hours in HOURS]
        for log, hours in zip(logs, HOURS, strict=True):
            write_log(_flown(hours), log)
        found = [[_process(log, monitor) for log in logs] for _ in range(rounds)]
        memory_gb = _scaled(*(_process(log, monitor, **PAGES_OF_THEIR_OWN)["memory_gb"] for log in logs))
    day = {key: statistics.median(_scaled(*(of[key] for of in pair)) for pair in found) for key in ("all_s", "watch_s")}
    seconds = DAY * 3600.0
    return {"ratio": seconds / day["all_s"], "watch_ratio": seconds / day["watch_s"], "memory_gb": memory_gb}


def _ready() -> gb.Monitor:
    flights = [gb.measure(gb.fly("gtm", "multisine+turbulence", 200.0, s), noise="t2", seed=s) for s in range(1, 7)]
    return gb.calibrate(flights, bank=gb.load_bank("C"))


def _flown(hours: int) -> gb.Record:
    """A healthy flight with the autopilot in the loop."""
    return gb.fly_in_loop("gtm", duration_s=3600.0 * hours, seed=1, sensors="ideal").sensed.select(CHANNELS)


def _scaled(short: float, long: float) -> float:
    return short + (DAY - HOURS[0]) * (long - short) / (HOURS[1] - HOURS[0])


def _process(log: Path, monitor: Path, **environment: str) -> dict:
    command = [sys.executable, "-m", __name__, str(log), str(monitor)]
    return json.loads(
        subprocess.run(
            command, cwd=ROOT, env=os.environ | environment, check=True, capture_output=True, text=True
        ).stdout
    )


def _alone(log: Path, monitor: Path) -> dict:
    """Watch a log as `gtmbench monitor` does, to the words of its report; then the watch by itself."""
    from gtmbench.detectors.registry import find_detector
    from gtmbench.log.watch import watch_log
    from gtmbench.report.words.log import log_report

    ready = find_detector(monitor)
    watched = watch_log(log, ready)
    report = log_report(watched)
    all_s, memory_gb = time.process_time(), status_bytes("VmHWM") / 1e9
    assert watched.outcome == 0, "\n".join(report)
    began = time.process_time()
    for segment in watched.log.segments:
        ready.watch(segment)
    return {"all_s": all_s, "watch_s": time.process_time() - began, "memory_gb": memory_gb}


if __name__ == "__main__":
    print(json.dumps(_alone(Path(sys.argv[1]), Path(sys.argv[2]))))
