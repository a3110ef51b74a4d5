"""Which lines of gtmbench each test executes, and its time: a plugin of pytest, and the map that it writes.

``python -m tests.mutation --reach`` runs the suite with it. Lines that a test's child processes execute aren't seen.
"""

from __future__ import annotations

import json
import os
import pickle
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import coverage
import pytest

FOLDER = Path("out/mutation")
WORKER = os.environ.get("PYTEST_XDIST_WORKER", "")
BETWEEN = "between tests"


def processor_s() -> float:
    """Return the processor's time that this process and the children that it waited for took."""
    told = os.times()
    return told.user + told.system + told.children_user + told.children_system


class Plugin:
    """Counts lines by test, in each worker."""

    def __init__(self) -> None:
        self.coverage = coverage.Coverage(data_file=str(FOLDER / f"lines-{WORKER}"), include=["*/gtmbench/*"])
        self.times: dict[str, float] = {}
        self.coverage.start()

    @pytest.hookimpl(hookwrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        self.coverage.switch_context(item.nodeid)
        began_s = processor_s()
        yield
        self.times[item.nodeid] = processor_s() - began_s
        self.coverage.switch_context(BETWEEN)

    def pytest_sessionfinish(self) -> None:
        self.coverage.stop()
        self.coverage.save()
        (FOLDER / f"times-{WORKER}.json").write_text(json.dumps(self.times))


def pytest_configure(config: pytest.Config) -> None:
    """Workers count; who hands out their tests runs none."""
    if WORKER:
        config.pluginmanager.register(Plugin())


@dataclass
class Reach:
    """Tests by what they execute, and what each takes of a processor."""

    seconds: dict[str, float] = field(default_factory=dict)
    lines: dict[str, dict[int, set[str]]] = field(default_factory=dict)

    def of(self, file: str, line: int) -> set[str]:
        """Return the tests that execute a line."""
        return self.lines.get(file, {}).get(line, set())


def collected(folder: Path = FOLDER) -> Reach:
    """Put together what the workers have written; kept beside it, because that takes its time."""
    kept = folder / "reach.pickle"
    parts = sorted(folder.glob("lines-*"))
    if kept.exists() and all(kept.stat().st_mtime > each.stat().st_mtime for each in parts):
        return pickle.loads(kept.read_bytes())
    reach = Reach()
    for each in sorted(folder.glob("times-*.json")):
        reach.seconds |= json.loads(each.read_text())
    for each in parts:
        data = coverage.CoverageData(str(each))
        data.read()
        for path in data.measured_files():
            lines = reach.lines.setdefault("gtmbench/" + path.rpartition("/gtmbench/")[2], {})
            for line, contexts in data.contexts_by_lineno(path).items():
                lines.setdefault(line, set()).update(each for each in contexts if each in reach.seconds)
    kept.write_bytes(pickle.dumps(reach))
    return reach
