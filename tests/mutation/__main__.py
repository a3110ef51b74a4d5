"""Do the tests see a change of the code? ``python -m tests.mutation ROOM [--count 500] [--seed 78]``.

A seeded draw of a room's mutants is tried, each by the tests that execute its line: `--reach` finds those beforehand,
by running the suite once. What no test fails is printed with its place; `equivalent.toml` lists those that change
nothing anybody could see, with the reason. It ends with 1 where fewer than nine of ten are killed. With `--idle` every
test of a mutant runs, and those are printed that kill nothing which others don't: they may go, or see more.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

from tests.mutation.mutants import Mutant, mutants
from tests.mutation.reach import FOLDER, Reach, collected, nearest, package, within
from tests.mutation.trial import failing, tried

ROOMS = ["method", "engine", "verdict", "detectors/statistics", "faults"]
ENOUGH = 0.9  # of mutants, to be killed


def main() -> int:
    """Try, print, and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=__doc__.partition("\n")[0])
    parser.add_argument(
        "rooms",
        nargs="*",
        metavar="ROOM",
        help=f"{', '.join(ROOMS)}, or another folder or file of gtmbench; without, the seed chooses",
    )
    parser.add_argument(
        "--reach", action="store_true", help="run the suite, or tests of ROOMs, and note what each executes"
    )
    parser.add_argument("--count", type=int, default=500, help="mutants a room")
    parser.add_argument("--seed", type=int, default=78)
    parser.add_argument("--constants", action="store_true", help="only numbers that stand at the top of a module")
    parser.add_argument("--seconds", type=float, default=60.0, help="of tests a mutant, the nearest and cheapest first")
    parser.add_argument("--all", action="store_true", help="by the tests of the night, too")
    parser.add_argument("--idle", action="store_true", help="print tests of ROOMs that kill no mutant alone")
    told = parser.parse_args()
    if told.reach:
        return noted(told.rooms)
    reach = collected()
    if not reach.seconds:
        parser.error("what tests execute isn't known yet; run: python -m tests.mutation --reach")
    done = [_room(room, reach, told) for room in told.rooms or [ROOMS[told.seed % len(ROOMS)]]]
    return int(not all(done))


def noted(rooms: list[str]) -> int:
    """Run the suite, or what is of some rooms by day, with the plugin that notes what each test executes."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for each in FOLDER.glob("*-*"):
        each.unlink()
    told = ["-q", "-n", "1" if rooms else "2", "--dist", "worksteal", "-p", "tests.mutation.reach"]
    paths = [path for room in rooms for top in ("tests", "gtmbench") if Path(path := f"{top}/{room}").exists()]
    return subprocess.run([sys.executable, "-m", "pytest", *told, *(paths or ["-m", ""])], check=False).returncode


def _room(room: str, reach: Reach, told: argparse.Namespace) -> bool:
    drawn = draw(room, told.count, told.seed, constants=told.constants)
    trials = [(each, *within(nearest(each, reach), reach, told.seconds, room)) for each in drawn]
    killers: dict[Mutant, list[str]] = {}
    for count, (mutant, tests) in enumerate(tried(trials, night=told.all, whole=told.idle), 1):
        killers |= {mutant: tests} if tests else {}
        if sys.stderr.isatty():
            print(f"\r  {room}: {len(killers)} of {count} killed, {len(drawn)} in all", end="", file=sys.stderr)
    unsound = failing(sorted(set().union(*killers.values()) & reach.seconds.keys()), night=told.all)
    killed = [each for each in drawn if set(killers.get(each, ())) - unsound]
    for mutant, tests, _ in trials:
        if mutant not in killed:
            print(f"  survived {len(tests)} tests: {mutant}")
    for each in sorted(unsound):
        print(f"  fails without a change, too: {each}")
    print(f"{room}: {len(killed)} of {len(drawn)} mutants killed ({len(killed) / max(len(drawn), 1):.0%})", flush=True)
    if told.idle:
        own = {each.partition("[")[0] for _, tests, _ in trials for each in tests if each.startswith(f"tests/{room}")}
        print(*idle(own, [set(killers[each]) - unsound for each in killed]), sep="\n", flush=True)
    return len(killed) >= ENOUGH * len(drawn)


def idle(tests: set[str], killers: list[set[str]]) -> list[str]:
    """Return a line for each test function without which as many mutants are killed: its kills, and its name."""
    kills: dict[str, set[int]] = {each: set() for each in tests}
    for mutant, names in enumerate(killers):
        for each in {name.partition("[")[0] for name in names}:
            kills.setdefault(each, set()).add(mutant)
    superfluous, left = [], [len({name.partition("[")[0] for name in names}) for names in killers]
    for each in sorted(tests, key=lambda test: (len(kills[test]), test)):
        if all(left[mutant] > 1 for mutant in kills[each]):
            superfluous.append(f"  {len(kills[each]):3d} {each}")
            for mutant in kills[each]:
                left[mutant] -= 1
    return superfluous


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
    return any(lists(each, mutant) for each in equivalents())


def lists(entry: dict[str, str], mutant: Mutant) -> bool:
    """Tell whether an entry is of a change at its own place: not wherever the line says the same once more."""
    if entry["file"] != mutant.file or entry["change"] != f"{mutant.before} -> {mutant.after}":
        return False
    found = re.finditer(re.escape(entry["line"]), "\n".join(package()[mutant.file]))
    return any(piece.start() <= mutant.begin and mutant.end <= piece.end() for piece in found)


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.exit(main())
