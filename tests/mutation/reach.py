"""Which lines of gtmbench each test executes, and its time: a plugin of pytest, the map that it writes, and its use.

``python -m tests.mutation --reach`` runs the suite with it. Lines that a test's child processes execute aren't seen.
"""

from __future__ import annotations

import ast
import json
import os
import pickle
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import coverage
import pytest

from tests.mutation.mutants import Mutant

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


@dataclass(eq=False)
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


def nearest(mutant: Mutant, reach: Reach) -> set[str]:
    """Return the tests that execute a mutant's line, or lines that use what it declares."""
    if mutant.names:
        return set().union(*(_users(name, reach) | _readers(name, mutant.file, reach) for name in mutant.names))
    for line in range(mutant.line, max(mutant.line - 30, 0), -1):  # a statement of many lines is known by its first
        if found := reach.of(mutant.file, line):
            return found
    return _users(mutant.function.rpartition(".")[2], reach)  # it runs while modules are imported


@cache
def _users(name: str, reach: Reach, further: int = 2) -> set[str]:
    """Return the tests that execute a line with a name; where that declares another one, this one's."""
    found: set[str] = set()
    for file, line in _words().get(name, ()):
        tests = reach.of(file, line)
        if not tests and further:
            tests = set().union(*(_users(each, reach, further - 1) for each in _declared(file).get(line, ())))
        found |= tests
    return found


def _readers(name: str, file: str, reach: Reach) -> set[str]:
    """Return the tests of files that read a name of a module themselves."""
    module = file.removesuffix(".py").replace("/", ".")
    files = {str(path) for path, text in _tests().items() if module in text and re.search(rf"\b{name}\b", text)}
    return {test for test in reach.seconds if test.partition("::")[0] in files}


@cache
def _tests() -> dict[Path, str]:
    """Return the text of every file of tests."""
    return {file: file.read_text() for file in Path("tests").rglob("test_*.py")}


@cache
def _words() -> dict[str, set[tuple[str, int]]]:
    """Return where in the package each word stands."""
    found: dict[str, set[tuple[str, int]]] = {}
    for file, lines in package().items():
        for number, line in enumerate(lines, 1):
            for word in re.findall(r"\w+", line):
                found.setdefault(word, set()).add((file, number))
    return found


@cache
def package() -> dict[str, list[str]]:
    """Return the lines of every file."""
    return {str(file): file.read_text().splitlines() for file in Path("gtmbench").rglob("*.py")}


@cache
def _declared(file: str) -> dict[int, tuple[str, ...]]:
    """Return what the lines of a file declare that aren't in a function: of a class its methods' names, too."""
    found: dict[int, tuple[str, ...]] = {}
    for node in ast.walk(ast.parse("\n".join(package()[file]))):
        if isinstance(node, ast.ClassDef):
            methods = [each.name for each in node.body if isinstance(each, ast.FunctionDef) and each.name[:2] != "__"]
            for each in node.body:
                if not isinstance(each, ast.FunctionDef):
                    found |= dict.fromkeys(range(each.lineno, each.end_lineno + 1), (node.name, *methods))
        elif isinstance(node, ast.Module):
            for each in node.body:
                if isinstance(each, ast.Assign | ast.AnnAssign):
                    target = each.targets[0] if isinstance(each, ast.Assign) else each.target
                    found |= dict.fromkeys(range(each.lineno, each.end_lineno + 1), (ast.unparse(target),))
    return found


def within(tests: set[str], reach: Reach, seconds: float, room: str) -> tuple[list[str], float]:
    """Return tests that take so long together, and how long: a room's own and those of few seconds, file by file."""
    own = (f"tests/{room}/", f"gtmbench/{room}")
    picked, whole = [], 0.0
    for each in sorted(tests, key=lambda test: (not test.startswith(own), reach.seconds[test], test)):
        if whole + reach.seconds[each] <= seconds:
            picked.append(each)
            whole += reach.seconds[each]
    picked.sort(key=lambda test: (not test.startswith(own), test.partition("::")[0], reach.seconds[test]))
    return picked, whole
