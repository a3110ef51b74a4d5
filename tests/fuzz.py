"""Damaged input at every door, for as long as one likes: ``python -m tests.fuzz --minutes 10``.

Doors are the readers of logs, a link's bytes and lines, and the files of monitors, scenarios, campaigns and aircraft.
What comes in is read, or refused by an error of our own; anything else, more than 10 s or more than 1 GB is a find.
Each is printed once and kept in out/fuzz/, described as in tests/damaged/, where it becomes a test. Where atheris is
installed (`make nightly` tries to) it chooses the input by what of gtmbench and of the reader's library it reaches,
else seeded damage does.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import os
import random
import re
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

from gtmbench.intake.formats import limits
from tests.helpers.disorder import disordered
from tests.helpers.doors import DOORS, TABLES, WATCHED, Door, damaged_files, described, tried
from tests.intake.test_intake_hostile import damaged

FINDS = Path("out/fuzz")
GUIDED = """
import sys
from atheris import import_hook
reached = {reached}
class Others:  # atheris itself tells packages apart, but not what is in them
    def __contains__(self, name):
        return not any((name + ".").startswith(each + ".") for each in reached)
with import_hook.HookManager({{each.split(".")[0] for each in reached}}, Others(), True, True):
    from tests.fuzz import main
    sys.exit(main())
"""
REACHED = {  # beside the readers, what of us and of libraries reads a door's files
    "monitor.json": ["gtmbench.detectors"],
    "scenario.toml": ["gtmbench.study.scenario", "gtmbench.faults", "gtmbench.bench", "gtmbench.checks", "tomllib"],
    "campaign.toml": ["gtmbench.study", "gtmbench.checks", "tomllib"],
    "aircraft.toml": ["gtmbench.bench", "gtmbench.checks", "tomllib"],
    "link": ["gtmbench.link"],
    "lines": ["gtmbench.link"],
    WATCHED: ["gtmbench.engine", "gtmbench.log"],
    "flight.bag": ["rosbags"],
    "flight.mat": ["scipy.io.matlab"],
    "flight73.mat": ["h5py"],
    **{name: ["openpyxl"] for name in DOORS if name.startswith("flight.xlsx")},
    "log.ulg": ["pyulog"],
    **{name: ["rosbags", "ruamel.yaml"] for name in DOORS if name.startswith("bag2/")},
}
MOST_BYTES, OUT_OF_TIME = 1 << 30, -1000  # no process ends with that
NASTY = ["1e308", "-1e308", "1e-320", "nan", "inf", "-1", "0", "1e30", "9007199254740993", "true", "[]", "{}", '""']


def keep(door: Door, data: bytes, what: str, known: set[str]) -> None:
    """Keep and print a find, once of its kind."""
    kind = what.partition(": ")[0]
    if kind in known:
        return
    known.add(kind)
    FINDS.mkdir(parents=True, exist_ok=True)
    name, text = described(door, data, what)
    (FINDS / name).write_text(text)
    print(f"FOUND at {door.name}: {what}; kept as {FINDS / name}", flush=True)


def broken(door: Door, seed: str) -> bytes:
    """Return what a door gets: damaged bytes, or, of every second table, rows in disorder."""
    is_disordered = door.name in TABLES and random.Random(f"rows {seed}").random() < 0.5
    return (disordered if is_disordered else damaged)(door.whole, seed)


def plain(door: Door, seed: int, until_s: float) -> tuple[int, set[str]]:
    """Damage what is whole until so much of a processor is used; return how often, and what was found."""
    known: set[str] = set()
    count = 0
    while processor_s() < until_s:
        data = broken(door, f"{door.name} {seed} {count}")
        if what := tried(door, data):
            keep(door, data, what, known)
        count += 1
    return count, known


@contextlib.contextmanager
def in_this_process():
    """Let readers that have a process of their own read in this one, so that atheris sees what they reach."""
    real = limits.subprocess

    def run(command, *, stdout, **_):
        limits.answer(command[-2], command[-1], stdout)
        return SimpleNamespace(returncode=0)

    limits.subprocess = SimpleNamespace(run=run, DEVNULL=real.DEVNULL, TimeoutExpired=real.TimeoutExpired)
    try:
        yield
    finally:
        limits.subprocess = real


def guided(door: Door, seed: int, seconds: int) -> None:
    """Let atheris choose the input; it ends the process."""
    import atheris

    corpus, dictionary = door.folder / "corpus", door.folder / "words"
    corpus.mkdir(exist_ok=True)
    (corpus / "whole").write_bytes(door.whole)
    for number in range(20):
        (corpus / str(number)).write_bytes(broken(door, f"{door.name} {seed} {number}"))
    for number, each in enumerate(each for each in damaged_files() if each.door == door.name):
        (corpus / f"known{number}").write_bytes(each.content(door))
    if door.name.endswith((".toml", ".json", ".yaml", ".csv", ".xml")):
        words = {*re.findall(r"[\w.-]{2,40}", door.whole.decode()), *NASTY}
        dictionary.write_text("".join(f'"{word}"\n' for word in sorted(words) if '"' not in word))
    known: set[str] = set()
    count = 0

    def one(data: bytes) -> None:
        nonlocal count
        count += 1
        (door.folder / "last").write_bytes(data)
        with in_this_process():
            what = tried(door, data)
        if what and (what := alone(door.name, data)):
            keep(door, data, what, known)
        if processor_s() > ends_s:
            print(f"{door.name}: {count} inputs by atheris, {len(known)} finds", flush=True)
            os._exit(bool(known))

    ends_s = processor_s() + seconds
    options = [f"-seed={seed + 1}", f"-max_len={2 * len(door.whole)}", "-rss_limit_mb=0", "-verbosity=0"]
    options += [f"-dict={dictionary}"] * dictionary.exists() + [f"-artifact_prefix={door.folder}/"]
    atheris.Setup([sys.argv[0], *options, str(corpus)], one)
    atheris.Fuzz()


def alone(name: str, data: bytes) -> str:
    """Return what a door does with bytes in a new process, as users have it: atheris' own runs out of memory itself."""
    with tempfile.TemporaryDirectory() as folder:
        held = Path(folder, "held")
        held.write_bytes(data)
        command = [sys.executable, "-m", "tests.fuzz", "--doors", name, "--again", str(held)]
        ended = subprocess.run(command, check=False, capture_output=True, text=True, timeout=600.0)
    said = ended.stdout.strip()
    return said if ended.returncode in (0, 1) else f"the process ended with {ended.returncode}"


def by_atheris(name: str, seed: int, seconds: float) -> int:
    """Run `guided` of a door in processes of their own until its time is used; return how many of them found anything.

    What brings a process down, or holds it still until its clock runs out, is a find where a new process shows it too.
    """
    code = GUIDED.format(reached=["gtmbench.intake", *REACHED.get(name, [])])
    until_s, found = processor_s() + seconds, 0
    while (left_s := until_s - processor_s()) > min(30.0, 0.5 * seconds):
        with tempfile.TemporaryDirectory() as folder:
            told = ["--minutes", f"{left_s / 60.0}", "--seed", str(seed), "--folder", folder]
            command = [sys.executable, "-c", code, "--guided", "--doors", name, *told]
            try:
                ended = subprocess.run(command, check=False, timeout=20.0 * left_s + 600.0).returncode
            except subprocess.TimeoutExpired:
                ended = OUT_OF_TIME
            if ended in (0, 1):
                return found + ended
            seed += 1000
            last = Path(folder, "last")
            data = last.read_bytes() if last.exists() else b""
            if what := alone(name, data):
                found += 1
                with tempfile.TemporaryDirectory() as again:
                    keep(Door(name, Path(again)), data, what, set())
            else:
                print(f"{name}: atheris ended with {ended}; a new process shows nothing", flush=True)
    return found


def processor_s() -> float:
    """Return the processors' time that this process and those that it has run took."""
    return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def main() -> int:
    """Fuzz, and return the exit code: 1 where anything was found."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0, help="of a processor, for all doors together")
    parser.add_argument("--seed", type=int, default=int(time.time()) // 86400, help="by default another one every day")
    parser.add_argument("--doors", nargs="*", default=DOORS, metavar="DOOR", help=", ".join(DOORS))
    parser.add_argument("--guided", action="store_true", help="of one door, in this process: by atheris")
    parser.add_argument("--folder", help="of --guided: where it works")
    parser.add_argument("--again", type=Path, help="of one door: what it does with this file's bytes")
    told = parser.parse_args()
    each_s = 60.0 * told.minutes / len(told.doors)
    has_atheris = importlib.util.find_spec("atheris") is not None
    resource.setrlimit(resource.RLIMIT_DATA, (MOST_BYTES + (1 << 29), -1))
    if told.again:
        with tempfile.TemporaryDirectory() as folder:
            what = tried(Door(told.doors[0], Path(folder)), told.again.read_bytes())
        print(what)
        return int(bool(what))
    if told.guided:
        guided(Door(told.doors[0], Path(told.folder)), told.seed, round(each_s))
    found = 0
    for name in told.doors:
        began_s = processor_s()
        if has_atheris and name != WATCHED:  # too slow to be guided
            found += by_atheris(name, told.seed, each_s)
        else:
            with tempfile.TemporaryDirectory() as folder:
                door = Door(name, Path(folder))
                count, known = plain(door, told.seed, processor_s() + each_s)
            print(f"{name}: {count} inputs damaged, {len(known)} finds", flush=True)
            found += len(known)
        print(f"{name}: {(processor_s() - began_s) / 60.0:.1f} minutes of a processor", flush=True)
    return int(found > 0)


if __name__ == "__main__":
    sys.exit(main())
