"""What studies with targets do alike: fly, tell, write a report, and end with an exit code."""

from __future__ import annotations

import argparse
import hashlib
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import click

from gtmbench.errors import GtmbenchError
from gtmbench.files.folders import atomic_folder, check_folder
from gtmbench.files.plain import dumps
from gtmbench.files.shipped import code_facts
from gtmbench.jobs.progress import Progress, progress_bar
from studies.tables import tables_in

DETAILS = "<!-- details -->"  # what a report says behind it stands in results.json alone
LIBRARIES = ("numpy", "scipy", "pandas", "jsbsim")  # their versions are kept with what they computed


class Findings(NamedTuple):
    """What a study found.

    Attributes
    ----------
    text : str
        The report, as Markdown.
    missed : bool
        Whether it misses a target.
    write : callable
        Writes what stands beside the report into a folder.
    """

    text: str
    missed: bool
    write: Callable[[Path], None]


class Campaign(NamedTuple):
    """How much is to be done: seconds' worth, by how many processes, whom to tell of progress, and what else is given.

    Attributes
    ----------
    quick : bool
    jobs : int
    tell : callable
    given : Namespace
        Every argument.
    """

    quick: bool
    jobs: int
    tell: Progress
    given: argparse.Namespace


def _no_more(parser: argparse.ArgumentParser) -> None:
    """Add nothing."""


def write_report(folder: Path, text: str, given: argparse.Namespace) -> None:
    """Write a report, and beside it all tables with what made them: the script, what it was given, versions, digests.

    What stands behind `DETAILS` is in the tables alone. Logs don't ship, so of each folder of them a digest of all that
    it holds is cited.
    """
    (folder / "report.md").write_text(short_form(text), encoding="utf-8")
    results = dumps({**_run(given), "tables": tables_in(text)}, indent=1)
    (folder / "results.json").write_text(results + "\n", encoding="utf-8")


def short_form(text: str) -> str:
    """Return a report up to its details, with a line that says where these are.

    >>> short_form("# Report")
    '# Report'
    """
    head, details, _ = text.partition(DETAILS)
    return f"{head.rstrip()}\n\nMore tables: `results.json`.\n" if details else text


def _digests(given: argparse.Namespace) -> dict[str, str]:
    """Return a digest of every folder that was given to read, by its name."""
    told = [value if isinstance(value, list) else [value] for name, value in vars(given).items() if name != "out"]
    digests = {}
    for folder in (each for values in told for each in values if isinstance(each, Path) and each.is_dir()):
        digest = hashlib.sha256()
        for path in sorted(path for path in folder.rglob("*") if path.is_file()):
            digest.update(path.relative_to(folder).as_posix().encode() + b"\0" + path.read_bytes())
        digests[folder.name] = digest.hexdigest()[:16]
    return digests


def _run(given: argparse.Namespace) -> dict[str, object]:
    """Return what a report's figures come from: the script, what it was given, versions and the code's digest."""
    asked = {name: value for name, value in vars(given).items() if name not in ("out", "jobs")}
    return {
        "script": Path(sys.argv[0]).name,
        "given": {name: _plain(value) for name, value in asked.items()},
        "code": code_facts(LIBRARIES),
        "logs": _digests(given),
    }


def _plain(value: object) -> object:
    """Return an argument as JSON has it; of a path its name alone, for folders lie elsewhere on another machine."""
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, Path):
        return value.name
    return value if value is None or isinstance(value, bool | int | float | str) else str(value)


def conducted(
    conduct: Callable[[Campaign], Findings],
    description: str | None,
    *,
    quick: str,
    beside: str = "rows",
    arguments: Callable[[argparse.ArgumentParser], object] = _no_more,
) -> int:
    """Conduct a study with ``--quick``, ``--out`` and ``--jobs``; return 1 where it misses a target, else 0.

    What ``--quick`` gives bounds nothing, so it misses none.

    Parameters
    ----------
    conduct : callable
    description : str
    quick : str
        What ``--quick`` does.
    beside : str
        What is written beside the report.
    arguments : callable
        Adds further arguments to the parser.
    """
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments(parser)
    parser.add_argument("--quick", action="store_true", help=f"{quick}: shows that it runs")
    parser.add_argument("--out", type=Path, help="folder of the report; without it only the tables are printed")
    parser.add_argument("--jobs", type=int, help="processes (default: all cores; one with --quick)")
    given, began = parser.parse_args(), time.monotonic()
    jobs = given.jobs or (1 if given.quick else os.cpu_count() or 1)
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # of the processes to come; two threads each would fight for the cores
    try:
        if given.out:
            given.out.parent.mkdir(parents=True, exist_ok=True)
            check_folder(given.out, force=True)
        with progress_bar() as tell:
            findings = conduct(Campaign(quick=given.quick, jobs=jobs, tell=tell, given=given))
        click.echo(findings.text)
        if given.out:
            with atomic_folder(given.out) as folder:
                write_report(folder, findings.text, given)
                findings.write(folder)
    except (GtmbenchError, OSError) as error:
        parser.error(str(error))
    click.echo(f"{time.monotonic() - began:.0f} s" + (f"; report and {beside} in {given.out}" if given.out else ""))
    return int(findings.missed and not given.quick)
