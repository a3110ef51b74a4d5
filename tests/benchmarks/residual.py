"""The residual and its norm on the main job's 50,001 samples, against what one would write with numpy."""

from __future__ import annotations

import numpy as np

import gtmbench as gb

from . import data
from .alone import relative
from .problem import Problem
from .timing import interleaved, peak_memory, ratio

WINDOW = 1000


def measure(rounds: int) -> dict:
    """Return ``gb.residual`` against copying the regressor and multiplying, and against np.correlate per channel.

    The others start from arrays without their means: removing those counts for ours only.
    """
    operator, record = data.identify(data.stretch()), data.measured(seed=2)
    u = record.matrix(data.INPUTS) - operator.input_means
    y = (record.matrix(data.OUTPUTS) - operator.output_means)[:, 0]
    markov, problem = operator.markov[:, 0, :], Problem(u, y, data.R, data.D)
    newest_last = np.ascontiguousarray(markov[::-1])

    def correlated() -> np.ndarray:
        return problem.target() - sum(np.correlate(u[:, i], newest_last[:, i], mode="valid") for i in range(3))

    works = {
        "ours": lambda: gb.residual(operator, record),
        "copied": lambda: problem.target() - problem.regressor() @ markov.ravel(),
        "correlated": correlated,
    }
    ours = works["ours"]().values[data.R : len(record) - data.D, 0]
    difference = max(relative(ours, works[name]()) for name in ("copied", "correlated"))
    times = interleaved(works, rounds)
    memory = {name: peak_memory(work) for name, work in works.items()}
    return {
        "ratio": ratio(times, "copied", "ours"),
        "memory_ratio": memory["copied"] / memory["ours"],
        "correlate_ratio": ratio(times, "correlated", "ours"),
        "correlate_memory_ratio": memory["correlated"] / memory["ours"],
        "rel_diff": difference,
    }


def measure_norm(rounds: int) -> dict:
    """Return E(k), ``gb.windowed_norm``, against summing the windows of sliding_window_view."""
    residual = gb.residual(data.identify(data.stretch()), data.measured(seed=2))
    squares = residual.values[:, 0] ** 2
    works = {
        "ours": lambda: gb.windowed_norm(residual, window=WINDOW),
        "summed": lambda: np.sqrt(np.lib.stride_tricks.sliding_window_view(squares, WINDOW + 1).sum(axis=1)),
    }
    difference = relative(works["ours"]().values[:-WINDOW], works["summed"]())
    times = interleaved(works, rounds)
    return {
        "ratio": ratio(times, "summed", "ours"),
        "memory_ratio": peak_memory(works["summed"]) / peak_memory(works["ours"]),
        "rel_diff": difference,
    }
