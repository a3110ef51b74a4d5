"""A Dask cluster on loopback, and rows of logs that its workers make, or die of."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

import gtmbench as gb
from gtmbench.log.fleet import Kept
from gtmbench.report.fleet import fleet_row

ROOT = Path(__file__).parents[2]


class Cluster:
    """A scheduler and its workers, a process each."""

    def __init__(self, folder, *options, workers=2, path=ROOT, nanny=False):
        self._path, self._nanny = path, ("--nanny" if nanny else "--no-nanny",)
        self._file = folder / "scheduler.json"
        self._options = options
        self._processes = []
        self.scheduler = self._begin("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-show", "--no-dashboard")
        self.workers = [self._worker() for _ in range(workers)]

    @property
    def address(self):
        for _ in range(600):
            with contextlib.suppress(OSError, ValueError, KeyError):
                return json.loads(self._file.read_text())["address"]
            time.sleep(0.05)
        raise AssertionError("no scheduler")

    def _worker(self):
        return self._begin("worker", "--nthreads", "1", *self._nanny, "--no-dashboard", "--host", "127.0.0.1")

    def _begin(self, what, *options):
        environment = {**os.environ, "PYTHONPATH": str(self._path), "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, "-m", "dask", what, "--scheduler-file", self._file, *options, *self._options]
        process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self._processes.append(process)
        return process

    def end(self):
        for process in self._processes:
            process.kill()
            process.wait()


def row_or_kill(watched, killer):
    """Return a row; once, kill the process above this one: the worker."""
    with contextlib.suppress(FileNotFoundError):
        killer.unlink()
        os.kill(os.getppid(), signal.SIGKILL)
        time.sleep(30.0)
    return Kept(fleet_row(watched), "page")


def row_or_worse(watched):
    """Return a row; of logs that are called so, raise, die, or last."""
    match watched.log.path.stem:
        case "raises":
            raise RecursionError("deep\nin it")
        case "dies":
            os.kill(os.getpid(), signal.SIGKILL)
        case "lasts":
            time.sleep(60.0)
    return row_alone(watched)


def row_alone(watched):
    return Kept(fleet_row(watched))


def forget(_log, _page):
    """Keep no page."""


def small_logs(folder, names):
    """Write two minutes in which q follows from p but for noise, under some names, and return the paths."""
    noise = np.random.default_rng(1).standard_normal((3000, 2))
    record = gb.Record(noise @ [[1.0, 1.0], [0.0, 0.1]], channels=["p", "q"], sample_period_s=0.04)
    for name in names:
        gb.write_log(record, folder / name)
    return [folder / name for name in names]
