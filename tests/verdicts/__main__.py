"""Print what comes out of the corpus of verdicts: ``python -m tests.verdicts [NAME ...] [--quick] [--list]``.

For each entry whose name begins with one of the names: the exit code, the first line, the spans of each sensor that is
broken, asked or required, and what isn't as it should be. It ends with 1 where something isn't.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from gtmbench.verdict.timeline import Timeline
from tests.verdicts.entries import SIX, Entry, entries
from tests.verdicts.recipes import made
from tests.verdicts.requirements import breaches, first_line, sensor_in, shown, watched


def main() -> int:
    """Print, and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.verdicts", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="what an entry's name begins with; all without")
    parser.add_argument("--quick", action="store_true", help="only those of `make test`")
    parser.add_argument("--list", action="store_true", help="print names, and what happens, alone")
    told = parser.parse_args()
    chosen = [each for each in entries() if _is_meant(each, told.names) and (each.quick or not told.quick)]
    if not chosen:
        parser.error(f"no entry begins with {' or '.join(told.names)}")
    if told.list:
        print(*(f"{each.name}: {each.about}" for each in chosen), sep="\n")
        return 0
    with TemporaryDirectory() as folder:
        right = [_tried(each, Path(folder)) for each in chosen]
    print(f"{sum(right)} of {len(right)} entries are as required")
    return 0 if all(right) else 1


def _is_meant(entry: Entry, names: list[str]) -> bool:
    return not names or any(entry.name.startswith(name) for name in names)


def _tried(entry: Entry, folder: Path) -> bool:
    """Print one entry, and return whether all is as required."""
    began_s = time.process_time()
    try:
        log = made(entry, folder)
        seen = watched(entry, log)
        found = breaches(entry, log, seen)
        lines = [f"exit {seen.verdict.exit_code}: {first_line(seen)}", *_spans(entry, seen.timeline)]
    except Exception as error:  # the next entries are to be looked at, too
        found, lines = [], [f"{type(error).__name__}: {error}"]
        failed = True
    else:
        failed = bool(found)
    is_right = failed == bool(entry.xfail)
    mark = "as required" if not failed else "NOT as required"
    print(
        f"{entry.name} ({time.process_time() - began_s:.1f} s): {mark}{f', as issue {entry.xfail}' * bool(entry.xfail)}"
    )
    print(f"  {entry.about}", *(f"  {line}" for line in lines), *(f"  ! {each}" for each in found), "", sep="\n")
    sys.stdout.flush()
    return is_right


def _spans(entry: Entry, timeline: Timeline) -> Iterator[str]:
    asked = dict.fromkeys((*entry.broken, *(each.sensor for each in entry.require), *SIX))
    for name in asked:
        sensor = sensor_in(timeline, name)
        if sensor is not None:
            yield f"{sensor:>5}  {shown(timeline.sensors[sensor])}"


if __name__ == "__main__":
    sys.exit(main())
