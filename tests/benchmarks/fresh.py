"""``gb.identify`` as a user's process has it, against numpy's lstsq there: first call, tenth, and after an lstsq.

In a fresh process nothing is warm, and the first call imports SciPy's linear algebra: counted and not counted. Seconds
of CPU, for a call is too short to be spared what else the machine does.
"""

from __future__ import annotations

import importlib
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from . import data
from .problem import Problem
from .solvers import numpy_lstsq

ROOT = Path(__file__).parent.parent.parent
CALLS = 10
NEEDED = ("scipy.linalg", "gtmbench.method.estimators.least_squares")


def measure(rounds: int) -> dict:
    """Return lstsq's time over that of our calls: medians over as many fresh processes as there are rounds."""
    with tempfile.TemporaryDirectory() as folder:
        given = Path(folder, "problem.npz")
        data.problem().save(given)
        command = [sys.executable, "-m", __name__, str(given)]
        found = [_process([*command, imported]) for _ in range(rounds) for imported in ("first", "before")]
    ratios = {}
    for name, imported, call in (
        ("with_imports", "first", "first_s"),
        ("first", "before", "first_s"),
        ("tenth", "before", "tenth_s"),
        ("after_lstsq", "before", "after_s"),
    ):
        ratios[name] = statistics.median(of["lstsq_s"] / of[call] for of in found if of["imported"] == imported)
    return ratios


def _process(command: list[str]) -> dict:
    told = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    return json.loads(told.stdout)


def _seconds(work: Callable[[], object]) -> float:
    began = time.process_time()
    work()
    return time.process_time() - began


def _alone(given: Path, imported: str) -> dict:
    """Time our calls, then lstsq, then ours once more."""
    import gtmbench as gb

    problem = Problem.load(given)
    values = np.column_stack([problem.inputs, problem.output])
    record = gb.Record(values, channels=[*data.INPUTS, *data.OUTPUTS], sample_period_s=0.01)
    if imported == "before":
        for name in NEEDED:
            importlib.import_module(name)
    ours = [_seconds(lambda: data.identify(record)) for _ in range(CALLS)]
    solve = numpy_lstsq(problem)
    lstsq_s = [_seconds(solve) for _ in range(3)]
    after_s = _seconds(lambda: data.identify(record))
    return {
        "imported": imported,
        "first_s": ours[0],
        "tenth_s": ours[-1],
        "after_s": after_s,
        "lstsq_s": statistics.median(lstsq_s),
    }


if __name__ == "__main__":
    print(json.dumps(_alone(Path(sys.argv[1]), sys.argv[2])))
