"""Commands as a user starts them, each a fresh process, beside their floor: what importing alone costs.

Seconds of CPU of the whole process, interpreter and all. A log has 120 s at 100 Hz of gyros and attitude.
"""

from __future__ import annotations

import resource
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import gtmbench as gb
from gtmbench.files.logs import write_log

ROOT = Path(__file__).parent.parent.parent
CHANNELS = ("p", "q", "r", "phi", "theta", "psi")
FLOOR = ("-c", "import numpy, pandas")
HELP = ("-m", "gtmbench", "--help")


def measure(rounds: int) -> dict:
    """Return what `gtmbench monitor` of a broken and of a healthy log, and imports, cost over their floors."""
    with tempfile.TemporaryDirectory() as folder:
        healthy, broken = Path(folder, "healthy.csv"), Path(folder, "broken.csv")
        record = gb.measure(gb.fly("gtm", "multisine", 120.0, 91), snr=50, seed=91).select(CHANNELS)
        write_log(record, healthy)
        write_log(gb.inject(record, gb.Drift(channel="r", onset_s=60.0, slope=0.3)), broken)
        watch = ("-m", "gtmbench", "monitor")
        lines = {
            "floor": FLOOR,
            "monitor_broken": (*watch, str(broken)),
            "monitor_healthy": (*watch, str(healthy)),
            "nothing": ("-c", "pass"),
            "api": ("-c", "import gtmbench.api"),
            "help": HELP,
        }
        found = [{name: _cpu_s(line) for name, line in lines.items()} for _ in range(rounds)]
    over = {"monitor_broken": "floor", "monitor_healthy": "floor", "api": "nothing", "help": "nothing"}
    return {name: statistics.median(of[name] / of[floor] for of in found) for name, floor in over.items()}


def _cpu_s(arguments: Sequence[str]) -> float:
    """Return the CPU that a process takes, its children's as well."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *arguments], cwd=ROOT, capture_output=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
