"""Damaged input at every door, for as long as one likes: ``python -m tests.fuzz --minutes 10``.

Doors are the readers of logs, a link's bytes and lines, and the files of monitors, scenarios, campaigns and aircraft.
What comes in is read, or refused by an error of our own; anything else, more than 10 s or more than 1 GB is a find.
Each is printed once and kept in out/fuzz/; it becomes a test. Where atheris is installed (`make nightly` tries to) it
chooses the input by what of gtmbench it reaches, else seeded damage does.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import importlib.util
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path

import gtmbench as gb
from gtmbench.bench.known_aircraft import load_aircraft
from gtmbench.files.shipped import share
from gtmbench.link.source import Delivery, Source
from tests.helpers import links, log_makers, monitors
from tests.intake.test_every_log_hostile import IN_PLACE
from tests.intake.test_intake_hostile import FORMATS, damaged, whole

PACKAGE = Path(gb.__file__).parent
FINDS = Path("out/fuzz")
GUIDED = """
import atheris, sys
with atheris.instrument_imports(include=["gtmbench.intake", "gtmbench.link", "gtmbench.detectors.bank"]):
    import gtmbench.api
from tests.fuzz import main
sys.exit(main())
"""
LONGEST_S, MOST_BYTES = 10, 1 << 30
FILES: dict[str, tuple[Callable[[Path], object], Path]] = {
    "monitor.json": (gb.load_monitor, PACKAGE / "baselines/bank-C.json"),
    "scenario.toml": (gb.load_scenario, PACKAGE / "cli/template.toml"),
    "campaign.toml": (gb.load_campaign, share() / "experiments/campaigns/ci.toml"),
    "aircraft.toml": (lambda path: load_aircraft(path.parent), share() / "aircraft/gtm/aircraft.toml"),
}


class _Pieces(Source):
    """Bytes as a link brings them, a few hundred at a time."""

    is_live = False

    def __init__(self, data: bytes, *, is_table: bool) -> None:
        super().__init__()
        self._data, self.is_table = data, is_table

    def deliveries(self):
        for number, place in enumerate(range(0, len(self._data), 300)):
            yield Delivery(1e9 + 0.1 * number, self._data[place : place + 300], ("127.0.0.1", 1))


class Door:
    """Where input comes in: what is whole there, and what takes it."""

    def __init__(self, name: str, folder: Path) -> None:
        self.name, self.folder = name, folder
        self._path = folder / name
        if name in FILES:
            self._reads, given = FILES[name]
            self.whole = given.read_bytes()
            if name.endswith(".json"):  # as older versions wrote it, without a digest, which would refuse all the rest
                document = json.loads(self.whole)
                del document["digest"]
                self.whole = json.dumps(document | {"version": 2}).encode()
        elif name in ("link", "lines"):
            record = monitors.record(400, seed=21)
            self.whole = b"".join(packet for _, packet in links.packets(record))
            if name == "lines":
                gb.write_log(record, folder / "lines.csv")
                self.whole = (folder / "lines.csv").read_bytes()
        elif name in FORMATS:
            self.whole, self._reads = whole(name), gb.open_log
        else:
            self.whole = log_makers.make(folder, name, log_makers.flight(4.0)).read_bytes()
            self._reads = gb.open_log

    def take(self, data: bytes) -> None:
        """Let it read some bytes."""
        if self.name in ("link", "lines"):
            with gb.live(_Pieces(data, is_table=self.name == "lines"), monitors.monitor()) as link:
                list(link)
            return
        self._path.write_bytes(data)
        self._reads(self._path)


def tried(door: Door, data: bytes) -> str:
    """Return what went wrong at a door, by which it is told apart from other finds; "" where nothing did."""
    began_s = time.monotonic()

    def ring(*_: object) -> None:
        raise TimeoutError

    signal.signal(signal.SIGALRM, ring)
    signal.alarm(LONGEST_S)
    try:
        with warnings.catch_warnings(), contextlib.redirect_stdout(None), contextlib.redirect_stderr(None):
            warnings.simplefilter("ignore")
            door.take(data)
    except gb.GtmbenchError as error:
        if "\n" in str(error):
            return "an error of several lines"
    except (Exception, TimeoutError) as error:
        frame = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__} in {Path(frame.filename).name}:{frame.lineno}: {str(error)[:100]}"
    finally:
        signal.alarm(0)
    took_s = time.monotonic() - began_s
    return f"it took {took_s:.0f} s" if took_s > LONGEST_S else ""


def keep(door: Door, data: bytes, what: str, known: set[str]) -> None:
    """Keep and print a find, once of its kind."""
    kind = what.partition(": ")[0]
    if kind in known:
        return
    known.add(kind)
    FINDS.mkdir(parents=True, exist_ok=True)
    path = FINDS / f"{hashlib.sha256(data).hexdigest()[:12]}-{door.name}"
    path.write_bytes(data)
    print(f"FOUND at {door.name}: {what}; kept as {path}", flush=True)


def plain(door: Door, seed: int, until_s: float) -> tuple[int, set[str]]:
    """Damage what is whole until a time; return how often, and what was found."""
    known: set[str] = set()
    count = 0
    while time.monotonic() < until_s:
        data = damaged(door.whole, f"{door.name} {seed} {count}")
        if what := tried(door, data):
            keep(door, data, what, known)
        count += 1
    return count, known


def guided(door: Door, seed: int, seconds: int) -> None:
    """Let atheris choose the input; it ends the process."""
    import atheris

    corpus = door.folder / "corpus"
    corpus.mkdir()
    (corpus / "whole").write_bytes(door.whole)
    for number in range(20):
        (corpus / str(number)).write_bytes(damaged(door.whole, f"{door.name} {seed} {number}"))
    known: set[str] = set()
    count = 0

    def one(data: bytes) -> None:
        nonlocal count
        count += 1
        if what := tried(door, data):
            keep(door, data, what, known)
        if time.monotonic() > ends_s:
            print(f"{door.name}: {count} inputs by atheris, {len(known)} finds", flush=True)
            os._exit(bool(known))

    ends_s = time.monotonic() + seconds
    options = [f"-seed={seed + 1}", f"-max_len={2 * len(door.whole)}", "-rss_limit_mb=0", "-verbosity=0"]
    atheris.Setup([sys.argv[0], *options, str(corpus)], one)
    atheris.Fuzz()


def main() -> int:
    """Fuzz, and return the exit code: 1 where anything was found."""
    names = [*FORMATS, *IN_PLACE, *FILES, "link", "lines"]
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0, help="of all doors together")
    parser.add_argument("--seed", type=int, default=int(time.time()) // 86400, help="by default another one every day")
    parser.add_argument("--doors", nargs="*", default=names, metavar="DOOR", help=", ".join(names))
    parser.add_argument("--guided", action="store_true", help="of one door, in this process: by atheris")
    told = parser.parse_args()
    each_s = 60.0 * told.minutes / len(told.doors)
    has_atheris = importlib.util.find_spec("atheris") is not None
    resource.setrlimit(resource.RLIMIT_DATA, (MOST_BYTES + (1 << 29), -1))
    found = 0
    for name in told.doors:
        with tempfile.TemporaryDirectory() as folder:
            if has_atheris and not told.guided:
                command = [sys.executable, "-c", GUIDED, "--guided", "--doors", name]
                options = ["--minutes", f"{each_s / 60.0}", "--seed", str(told.seed)]
                found += subprocess.run([*command, *options], check=False).returncode != 0
                continue
            door = Door(name, Path(folder))
            if told.guided:
                guided(door, told.seed, round(each_s))
            count, known = plain(door, told.seed, time.monotonic() + each_s)
            print(f"{name}: {count} inputs damaged, {len(known)} finds", flush=True)
            found += len(known)
    return int(found > 0)


if __name__ == "__main__":
    sys.exit(main())
