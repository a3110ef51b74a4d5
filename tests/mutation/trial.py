"""Mutants are tried in children of a process that has loaded what tests need: each costs little more than its tests.

What a function does is changed in place: its code becomes the mutant's, wherever the function is held. What was
executed while modules and tests were loaded (constants, defaults, classes, functions that were called then) can't be
changed so: there the child imports gtmbench itself, and of one file another text.
"""

from __future__ import annotations

import gc
import importlib.util
import json
import os
import resource
import select
import signal
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator
from functools import partial
from importlib.machinery import ModuleSpec, SourceFileLoader
from pathlib import Path
from types import CodeType, FrameType, FunctionType
from typing import Any

import pytest
from hypothesis import Phase, settings

from tests.mutation.mutants import Mutant

LOADED = ("click", "matplotlib.pyplot", "pandas", "pyarrow", "rerun", "scipy.optimize", "scipy.signal", "scipy.stats")
"""What gtmbench and its tests import, and what takes most of the time of an import."""
LEAST_S, SLOWER, MOST_BYTES = 20.0, 20.0, 8 << 30
"""Of a processor, what a mutant may take beside twice its tests' time; how much more by the clock; its memory."""
ENDED = "the end of its time, or of the run"

Trial = tuple[Mutant, list[str], float]
"""A mutant, the tests that execute its line, and the seconds that these take."""
Say = Callable[[Any], object]
Place = tuple[str, str, int]
Held = dict[Place, list[FunctionType]]
Changes = list[tuple[FunctionType, CodeType]]


def tried(trials: list[Trial], *, night: bool = False, whole: bool = False) -> Iterator[tuple[Mutant, list[str]]]:
    """Yield each mutant with the test that failed first, or nothing; with every test that fails, if `whole`."""
    for each in LOADED:
        importlib.import_module(each)
    left = dict(enumerate(trials))
    files = sorted({test.partition("::")[0] for _, tests, _ in trials for test in tests})
    said = _said(lambda say: _pytest(files, InPlace(trials, say, whole), night))
    if isinstance(gone := next(said), str):
        raise RuntimeError(f"tests can't be collected: {gone}")
    for number, failed in said:
        yield left.pop(number)[0], failed
    for mutant, tests, seconds in left.values():
        there = [each for each in tests if each not in gone]
        yield mutant, _failed(partial(_anew, mutant, there, night, whole), seconds) if there else []


def failing(tests: list[str], *, night: bool = False) -> set[str]:
    """Return the tests that fail although nothing is changed."""
    return set(_said(lambda say: _pytest(tests, Failing(say), night))) if tests else set()


def _said(work: Callable[[Say], None], seconds: float | None = None) -> Iterator[Any]:
    """Do work in a child, and yield what it says until it ends, or its time."""
    reading, writing = os.pipe()
    if not (child := os.fork()):
        _work(work, writing, seconds)
    os.close(writing)
    try:
        with open(reading, "rb", buffering=0) as lines:  # noqa: PTH123 (a pipe has no path)
            while select.select([lines], [], [], seconds and SLOWER * seconds)[0] and (line := lines.readline()):
                yield json.loads(line)
    finally:
        os.killpg(child, signal.SIGKILL)
        os.waitpid(child, 0)


def _work(work: Callable[[Say], None], writing: int, seconds: float | None) -> None:
    """Do it in a group of its own, within limits and silently, and end."""
    try:
        os.setpgid(0, 0)
        if seconds:
            resource.setrlimit(resource.RLIMIT_CPU, (round(seconds), round(seconds) + 5))
            resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
        for each in range(3):
            os.dup2(os.open(os.devnull, os.O_RDWR), each)
        work(lambda what: os.write(writing, json.dumps(what).encode() + b"\n"))
    finally:
        os._exit(0)


def _failed(work: Callable[[Say], None], seconds: float) -> list[str]:
    """Return the tests that fail, which the child says once."""
    return next(_said(work, 2.0 * seconds + LEAST_S), [ENDED])


def _pytest(told: list[str], plugin: Failing, night: bool) -> None:
    """Run it; say, too, where nothing could be imported to begin with."""
    # pytest would import what ships a plugin by itself, to rewrite its asserts, and from the file
    options = ["-q", "-s", "--assert=plain", "-p", "no:cacheprovider", "-p", "no:xdist", *(["-m", ""] if night else [])]
    ended = pytest.main([*options, *told], plugins=[plugin])
    if ended not in {pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED, pytest.ExitCode.NO_TESTS_COLLECTED}:
        plugin.say(ENDED)


def _anew(mutant: Mutant, tests: list[str], night: bool, whole: bool, say: Say) -> None:
    """Run tests after gtmbench was imported with the change."""
    failed: list[str] = []
    sys.meta_path.insert(0, Changed(Path(mutant.file), mutant.applied(Path(mutant.file).read_text())))
    _pytest(tests if whole else ["-x", *tests], Failing(failed.append), night)
    say(failed)


class Changed(SourceFileLoader):
    """Imports one module from another text than its file's."""

    def __init__(self, file: Path, text: str) -> None:
        super().__init__(".".join(file.with_suffix("").parts).removesuffix(".__init__"), str(file.resolve()))
        self.text = text

    def find_spec(self, name: str, *_: object) -> ModuleSpec | None:
        """Return where the one module comes from."""
        return importlib.util.spec_from_file_location(name, self.path, loader=self) if name == self.name else None

    def get_code(self, fullname: str) -> CodeType:
        """Compile the other text, whatever is kept of the file's."""
        return compile(self.text, self.path, "exec", dont_inherit=True)


class Failing:
    """Says which tests fail, and which files can't be collected."""

    def __init__(self, say: Say) -> None:
        self.say = say

    @pytest.hookimpl(trylast=True)
    def pytest_configure(self) -> None:
        """What hypothesis finds isn't made smaller: it is only asked whether anything fails."""
        settings.register_profile("mutants", phases=[Phase.explicit, Phase.generate])
        settings.load_profile("mutants")

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.failed:
            self.say(report.nodeid)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self.say(report.nodeid)


class InPlace(Failing):
    """Collects tests once, and tries those mutants that can be put in place."""

    def __init__(self, trials: list[Trial], say: Say, whole: bool) -> None:
        super().__init__(say)
        self.trials, self.whole = trials, whole
        self.called: set[Place] = set()
        sys.setprofile(self._note)

    def _note(self, frame: FrameType, event: str, _: object) -> None:
        if event == "call":
            self.called.add(place(frame.f_code))

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """In place of running the tests, try mutants."""
        sys.setprofile(None)
        held = functions()
        items = {each.nodeid: each for each in session.items}
        self.say(sorted({each for _, tests, _ in self.trials for each in tests} - items.keys()))
        for number, (mutant, tests, seconds) in enumerate(self.trials):
            picked = [items[each] for each in tests if each in items]
            if picked and (found := changes(mutant, held, self.called)):
                self.say([number, _failed(partial(self._run, found, picked), seconds)])
        return True

    def _run(self, found: Changes, picked: list[pytest.Item], say: Say) -> None:
        failed: list[str] = []
        self.say = failed.append
        for function, code in found:
            function.__code__ = code
        for item, following in zip(picked, [*picked[1:], None], strict=True):
            item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
            if failed and not self.whole:
                break
        say(failed)


def functions() -> Held:
    """Return every function that there is, by the place of its code."""
    held = defaultdict(list)
    gc.unfreeze()
    for each in gc.get_objects():
        if type(each) is FunctionType:
            held[place(each.__code__)].append(each)
    gc.freeze()
    return held


def changes(mutant: Mutant, held: Held, called: set[Place]) -> Changes:
    """Return functions with their changed codes; none where the change would come too late."""
    text, path = Path(mutant.file).read_text(), str(Path(mutant.file).resolve())
    codes = [compile(each, path, "exec", dont_inherit=True) for each in (text, mutant.applied(text))]
    parted = list(_parted(*codes))
    found = [(each, changed) for code, changed in parted for each in held.get(place(code), ())]
    late = mutant.names or place(parted[-1][0]) in called
    return [] if late or any(each.__code__.co_freevars != code.co_freevars for each, code in found) else found


def _parted(code: CodeType, changed: CodeType) -> Iterator[tuple[CodeType, CodeType]]:
    """Yield which codes differ, a file's first, then those within: the innermost is the last."""
    yield code, changed
    for each, other in zip(
        *([c for c in one.co_consts if isinstance(c, CodeType)] for one in (code, changed)), strict=False
    ):
        if each != other:
            yield from _parted(each, other)


def place(code: CodeType) -> Place:
    return code.co_filename, code.co_qualname, code.co_firstlineno
