"""Do the tests see a change of the code? ``python -m tests.mutation ROOM [--count 500] [--seed 78]``.

A seeded draw of a room's mutants is tried, each by the tests that execute its line: `--reach` finds those beforehand,
by running the suite once. What no test fails is printed with its place; `equivalent.toml` lists those that change
nothing anybody could see, with the reason. It ends with 1 where fewer than nine of ten are killed.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import resource
import signal
import subprocess
import sys
import tempfile
import tomllib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from tests.mutation.mutants import Mutant, mutants
from tests.mutation.reach import FOLDER, Reach, collected, nearest, package, within

ROOMS = ["method", "engine", "verdict", "detectors/statistics", "faults"]
ENOUGH, LEAST_S = 0.9, 60.0
"""Of mutants, to be killed; and of a processor, what a mutant may take beside twice its tests' time."""


@dataclass(frozen=True)
class Tried:
    """What became of a mutant: the test that failed first, or none."""

    mutant: Mutant
    tests: int
    killed_by: str


def main() -> int:
    """Try, print, and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=__doc__.partition("\n")[0])
    parser.add_argument(
        "rooms",
        nargs="*",
        metavar="ROOM",
        help=f"{', '.join(ROOMS)}, or another folder or file of gtmbench; without, the seed chooses",
    )
    parser.add_argument("--reach", action="store_true", help="run the suite and note what each test executes")
    parser.add_argument("--count", type=int, default=500, help="mutants a room")
    parser.add_argument("--seed", type=int, default=78)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--constants", action="store_true", help="only numbers that stand at the top of a module")
    parser.add_argument("--seconds", type=float, default=60.0, help="of tests a mutant, the nearest and cheapest first")
    parser.add_argument("--all", action="store_true", help="by the tests of the night, too")
    told = parser.parse_args()
    if told.reach:
        return noted()
    reach = collected()
    if not reach.seconds:
        parser.error("what tests execute isn't known yet; run: python -m tests.mutation --reach")
    done = [_room(room, reach, told) for room in told.rooms or [ROOMS[told.seed % len(ROOMS)]]]
    return int(not all(done))


def noted() -> int:
    """Run the suite with the plugin that notes what each test executes."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for each in FOLDER.glob("*-*"):
        each.unlink()
    told = ["-q", "-n", "2", "--dist", "worksteal", "-p", "tests.mutation.reach", "-m", ""]
    return subprocess.run([sys.executable, "-m", "pytest", *told], check=False).returncode


def _room(room: str, reach: Reach, told: argparse.Namespace) -> bool:
    drawn = draw(room, told.count, told.seed, constants=told.constants)
    killed = 0
    with ThreadPoolExecutor(told.jobs) as pool:
        for count, each in enumerate(pool.map(lambda mutant: tried(mutant, reach, told.seconds, told.all), drawn), 1):
            killed += bool(each.killed_by)
            if not each.killed_by:
                print(f"  survived {each.tests} tests: {each.mutant}", flush=True)
            elif sys.stderr.isatty():
                print(f"\r  {room}: {killed} of {count} killed, {len(drawn)} in all", end="", file=sys.stderr)
    print(f"{room}: {killed} of {len(drawn)} mutants killed ({killed / max(len(drawn), 1):.0%})", flush=True)
    return killed >= ENOUGH * len(drawn)


def draw(room: str, count: int, seed: int, *, constants: bool) -> list[Mutant]:
    """Return a seeded draw of a room's mutants, without those that change nothing."""
    place = Path("gtmbench", room)
    files = sorted(place.rglob("*.py")) if place.is_dir() else [place.with_suffix(".py")]
    found = [mutant for file in files for mutant in mutants(str(file), file.read_text())]
    found = [each for each in found if not _is_equivalent(each) and (not constants or not each.function)]
    drawn = random.Random(f"{seed} {room}").sample(found, min(count, len(found)))
    return sorted(drawn, key=lambda each: (each.file, each.begin))


@cache
def equivalents() -> list[dict[str, str]]:
    """Return what is listed as changing nothing, with the reasons."""
    return tomllib.loads(Path(__file__).with_name("equivalent.toml").read_text())["mutant"]


def _is_equivalent(mutant: Mutant) -> bool:
    change, line = f"{mutant.before} -> {mutant.after}", package()[mutant.file][mutant.line - 1]
    return any(
        each["file"] == mutant.file and each["change"] == change and each["line"] in line for each in equivalents()
    )


def tried(mutant: Mutant, reach: Reach, seconds: float, night: bool) -> Tried:
    """Try a mutant by the tests that execute its line, in a process of its own."""
    tests = list(within(nearest(mutant, reach), reach, seconds))
    if not tests:
        return Tried(mutant, 0, "")
    with tempfile.TemporaryDirectory() as folder:
        list_of_tests, text = Path(folder, "tests"), Path(folder, "source")
        list_of_tests.write_text("\n".join(tests))
        text.write_text(mutant.applied(Path(mutant.file).read_text()))
        most_s = 2.0 * sum(reach.seconds[each] for each in tests) + LEAST_S
        command = [sys.executable, "-m", "tests.mutation.trial", mutant.file, text, list_of_tests, str(int(night))]

        def bounded() -> None:
            resource.setrlimit(resource.RLIMIT_CPU, (round(most_s), round(most_s) + 5))

        try:
            ended = subprocess.run(
                command, check=False, capture_output=True, text=True, timeout=20.0 * most_s, preexec_fn=bounded
            )
        except subprocess.TimeoutExpired:
            return Tried(mutant, len(tests), "the clock")
    if ended.returncode == 0:
        return Tried(mutant, len(tests), "")
    if ended.returncode == 5:  # none was left to be run
        return Tried(mutant, 0, "")
    failed = re.search(r"^(?:FAILED|ERROR) (.*?)(?: - |$)", ended.stdout, re.M)
    ends = "the clock" if ended.returncode == -signal.SIGXCPU else "what ended the run"
    return Tried(mutant, len(tests), failed[1] if failed else ends)


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.exit(main())
