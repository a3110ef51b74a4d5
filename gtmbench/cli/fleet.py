"""A fleet of logs on the command line: what ``gtmbench monitor`` does with more than one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from click import UsageError

from gtmbench.cli.output import echo, print_json, print_table, screen_width
from gtmbench.errors import InputError
from gtmbench.files.disk import is_file, is_pattern
from gtmbench.jobs.progress import progress_bar

if TYPE_CHECKING:
    from gtmbench.study.log.log_fleet import FleetQuestion, Source

_MOST_ROWS = 40  # on a screen


def is_fleet(sources: Sequence[Source], out: Path | None) -> bool:
    """Whether more than a log is meant: several, a folder, a pattern, or a folder to write into."""
    if not sources:
        raise UsageError("Missing argument 'LOG|DIR|GLOB...'.")
    (first, *others) = sources
    if others or out is not None:
        return True
    if isinstance(first, str):  # of an object the name tells
        return not Path(first).suffix or is_pattern(first)
    from gtmbench.intake.read import is_log_folder

    try:
        return (first.is_dir() and not is_log_folder(first)) or (not first.exists() and is_pattern(str(first)))
    except (OSError, ValueError):
        return False


def monitor_fleet(
    sources: Sequence[Source],
    watching: FleetQuestion,
    out: Path | None,
    *,
    jobs: int,
    scheduler: str | None,
    tls: Path | None,
    resume: bool,
    as_json: bool,
    quiet: bool,
) -> int:
    """Watch logs into a folder, print a table, and return the exit code."""
    from gtmbench.report.fleet_report import FIGURE, REPORT, TABLE, written
    from gtmbench.report.tables.fleet import fleet_results
    from gtmbench.report.words.fleet import MEANING, RIGHT, fleet_table

    logs = watching.logs_of(sources)
    if out is None:
        raise InputError(f"logs found: {len(logs)}; their results go into a folder: give --out DIR")
    with progress_bar(silent=as_json or quiet) as tell:
        parts = written(logs, watching, out, jobs=jobs, scheduler=scheduler, tls=tls, resume=resume, progress=tell)
    results = fleet_results(parts)
    rows = results["logs"]
    if as_json:
        print_json(results | {"out": str(out)})
    elif not quiet:
        echo(results["verdict"])
        names, cells = fleet_table(rows[:_MOST_ROWS], screen_width())
        print_table(f"{out}", names, cells, right=RIGHT)
        if len(rows) > _MOST_ROWS:
            echo(f"{len(rows) - _MOST_ROWS} logs more stand in {out / REPORT}")
        for name in names:
            if name in MEANING:
                echo(MEANING[name])
        files = [name for name in (REPORT, TABLE, FIGURE) if is_file(out / name)]
        echo(f"{', '.join(files)}, {len(rows)} parts: {out}/")
    return int(results["exit_code"])
