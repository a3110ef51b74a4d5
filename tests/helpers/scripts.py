"""The scripts of `experiments/`, as the tests see them."""

import runpy
from functools import cache
from pathlib import Path

EXPERIMENTS = Path(__file__).parents[2] / "experiments"


@cache
def script(name):
    """Return what a script defines, none of its rows run."""
    return runpy.run_path(str(EXPERIMENTS / f"{name}.py"))
