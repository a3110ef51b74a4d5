"""Every solver a user would reach for: here or, where its pins conflict with ours, in an environment of its own."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from . import data
from .alone import against_lstsq
from .problem import Problem
from .solvers import SOLVERS, Solver

ROOT = Path(__file__).parents[2]


def measure(identification: dict, rounds: int, tell: Callable[[str], None]) -> dict:
    """Return a row a solver: time and memory over ours, the difference of the Markov parameters, or why there is none.

    Time over ours is time over lstsq, in the solver's own environment, times lstsq's over ours in this one.
    """
    problem = data.problem()
    rows = {}
    for name, solver in SOLVERS.items():
        tell(f"  {name}")
        row = _alone(name, solver, problem) if solver.environment else _here(name, problem, rounds)
        if "failed" not in row:
            row["ratio"] = row["lstsq_ratio"] * identification["ratio"]
            row["memory_ratio"] = row.pop("memory_mb") / identification["memory_mb"]
        rows[name] = {**row, "note": solver.note}
    return rows


def _here(name: str, problem: Problem, rounds: int) -> dict:
    try:
        return against_lstsq(name, problem, rounds)
    except ImportError as error:
        return {"failed": f"can't be imported: {error.name}"}


def _alone(name: str, solver: Solver, problem: Problem) -> dict:
    python = _environment(solver)
    if python is None:
        return {"failed": f"not installed: pip couldn't get {' '.join(solver.environment)}"}
    with tempfile.TemporaryDirectory() as folder:
        given, result = Path(folder, "problem.npz"), Path(folder, "result.json")
        problem.save(given)
        command = [python, "-m", f"{__package__}.alone", name, given, result, "1"]  # once: seconds, not milliseconds
        if subprocess.run(command, cwd=ROOT, check=False).returncode:
            return {"failed": "failed in its environment; what it said stands above"}
        return json.loads(result.read_text())


def _environment(solver: Solver) -> Path | None:
    """Return the Python of the solver's own environment, made at need; None where pip fails."""
    folder = ROOT / f".venv-bench-{solver.package}"
    python, ready = folder / "bin/python", folder / "ready"
    wanted = " ".join(solver.environment)
    if ready.exists() and ready.read_text() == wanted:
        return python
    pip = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *solver.environment]
    for command in ([sys.executable, "-m", "venv", "--clear", folder], pip):
        if subprocess.run(command, check=False).returncode:
            return None
    ready.write_text(wanted)
    return python
