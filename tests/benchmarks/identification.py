"""``gb.identify`` against numpy's lstsq on the main job's stretch: 17,400 equations, 303 parameters."""

from __future__ import annotations

import numpy as np

from . import data
from .alone import relative
from .solvers import LSTSQ, numpy_lstsq
from .timing import interleaved, peak_memory, ratio

OURS, BUILDING = "gb.identify", "lstsq and its regressor"


def measure(rounds: int) -> dict:
    """Return times and memories of lstsq over ours, and the difference of the Markov parameters."""
    record, problem = data.stretch(), data.problem()
    solve = numpy_lstsq(problem)
    operator, wanted = data.identify(record, "records"), solve()  # solvers get samples freed of the record's means
    works = {OURS: lambda: data.identify(record), LSTSQ: solve, BUILDING: lambda: numpy_lstsq(problem)()}
    times = interleaved(works, rounds)
    del solve, works[LSTSQ]
    memory, theirs = peak_memory(works[OURS]), peak_memory(works[BUILDING])
    return {
        "ratio": ratio(times, LSTSQ, OURS),
        "ratio_with_regressor": ratio(times, BUILDING, OURS),
        "memory_ratio": theirs / memory,
        "memory_mb": memory / 1e6,
        "markov_rel_diff": relative(np.asarray(operator.markov[:, 0, :]), wanted),
    }
