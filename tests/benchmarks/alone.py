"""One solver beside numpy lstsq, in this process: for the peers here, and as a script in an environment of its own.

``python -m tests.benchmarks.alone NAME PROBLEM.npz RESULT.json ROUNDS``, from the root. No import of gtmbench.
"""

from __future__ import annotations

import json
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np

from .problem import Problem
from .solvers import LSTSQ, SOLVERS
from .timing import interleaved, peak_memory, ratio

WARM_UP = 2000  # samples


def against_lstsq(name: str, problem: Problem, rounds: int) -> dict:
    """Return the solver's time over lstsq's, its peak memory (regressor included) and the parameters' difference."""
    solver = SOLVERS[name]
    for warmed in (name, LSTSQ):
        SOLVERS[warmed].prepare(problem.start(WARM_UP))()
    memory = peak_memory(lambda: solver.prepare(problem)())
    works = {which: SOLVERS[which].prepare(problem) for which in (name, LSTSQ)}
    found: dict[str, np.ndarray] = {}

    def solve() -> None:
        found["markov"] = works[name]()

    times = interleaved({**works, name: solve}, rounds)
    return {
        "version": version(solver.package),
        "lstsq_ratio": ratio(times, name, LSTSQ),
        "memory_mb": memory / 1e6,
        "markov_rel_diff": _difference(found["markov"], problem, constant=solver.constant),
    }


def _difference(markov: np.ndarray, problem: Problem, *, constant: bool) -> float:
    regressor, target = problem.regressor(constant=constant), problem.target()
    wanted = problem.markov(np.linalg.lstsq(regressor, target, rcond=None)[0])
    return relative(markov, wanted)


def relative(found: np.ndarray, wanted: np.ndarray) -> float:
    """Return the norm of the difference over the norm of what is wanted; NaN stands where it stands."""
    both = np.isfinite(found) & np.isfinite(wanted)
    assert np.array_equal(np.isfinite(found), np.isfinite(wanted))
    return float(np.linalg.norm(found[both] - wanted[both]) / np.linalg.norm(wanted[both]))


if __name__ == "__main__":
    name, problem, result, rounds = sys.argv[1:]
    figures = against_lstsq(name, Problem.load(Path(problem)), int(rounds))
    Path(result).write_text(json.dumps(figures))
