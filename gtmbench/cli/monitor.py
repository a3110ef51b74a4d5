"""``gtmbench monitor``: a recorded flight, watched; or a fleet of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gtmbench.checks import whole
from gtmbench.cli.history import keeping_of, monitor_history, written_lines
from gtmbench.cli.options import (
    cluster_options,
    detector_option,
    healthy_option,
    healthy_part,
    import_option,
    map_files,
    map_option,
    rate_option,
    refuse,
    scope_options,
)
from gtmbench.cli.output import (
    PATH,
    HeadedCommand,
    claim_file,
    command_line,
    common_options,
    finish,
    is_json,
    is_silent,
    print_columns,
    print_json,
    print_table,
    say,
    screen_width,
    shown_progress,
)
from gtmbench.errors import InputError
from gtmbench.files.writing import atomic_write, is_file, is_pattern
from gtmbench.jobs.progress import limited

if TYPE_CHECKING:
    from gtmbench.log.fleet import FleetQuestion, Source
    from gtmbench.log.watched_log import WatchedLog

_OUTPUTS = ("record", "reports", "force", "details", "as_json", "quiet")  # that change no verdict
_MOST_ROWS = 40  # of a fleet on a screen


class Log(click.ParamType[Path | str]):
    """A log's path, or an object's address, which stays as it is written."""

    name = "log"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path | str:  # noqa: ARG002
        """Return either."""
        from gtmbench.intake.objects import is_address

        return value if is_address(value) else Path(value)


@click.command("monitor", cls=HeadedCommand)
@click.argument("logs", nargs=-1, metavar="LOG|DIR|GLOB|ADDRESS...", type=Log())
@map_option
@rate_option
@click.option("--system", metavar="N", help="The system that is meant, of a telemetry log of several.")
@detector_option("The default, auto, uses the relations that the log's channels allow.")
@healthy_option("[default: the first 40 % of its motion, 300 s at most]")
@scope_options
@click.option("--details", is_flag=True, help="Print everything that is known, after the verdict; takes some seconds.")
@click.option(
    "--list", "listed", is_flag=True, help="List the log's sensors and what can be watched; with --details all columns."
)
@click.option(
    "--history",
    type=PATH,
    help="Judge beside the aircraft's earlier flights in this file, or folder of logs, and enter this one.",
)
@click.option("--aircraft-id", metavar="NAME", help="Whose flight it is.  [default: by the log's hardware, or folder]")
@click.option("--record", type=PATH, help="Write a recording (.rrd) for `gtmbench view`.")
@click.option(
    "--report",
    "reports",
    multiple=True,
    type=PATH,
    help="Write a page (.html) to file or to mail, or a figure (.png). Repeat it for both.",
)
@click.option("--out", type=PATH, help="For several logs: folder for table, figure, report and parts.")
@click.option("--jobs", type=int, help="For several logs: processes.  [default: 1]")
@click.option("--resume", is_flag=True, help="For several logs: continue the run in the folder.")
@cluster_options
@click.option("--time-limit", type=float, help="Seconds allowed for a log.  [default: none; 900 for each of several]")
@import_option
@click.option("--force", is_flag=True, help="Write over existing files.")
@common_options
def monitor_command(
    logs: tuple[Source, ...],
    system: str | None,
    detector: str | None,
    healthy: tuple[str, ...],
    details: bool,
    listed: bool,
    history: Path | None,
    aircraft_id: str | None,
    record: Path | None,
    reports: tuple[Path, ...],
    out: Path | None,
    jobs: int | None,
    resume: bool,
    scheduler: str | None,
    tls: Path | None,
    time_limit: float | None,
    force: bool,
    **how: Any,  # else is as `watch_log` takes it
) -> int:
    """Watch a recorded flight, and say whether one of its sensors lied.

    Example: gtmbench monitor flight.csv

    It reads CSV, Parquet, PX4 ULog, ArduPilot, MAVLink telemetry, ROS bags, MCAP, MATLAB and more, and reports for
    every sensor when it was clear, failed or could not be judged. What the log doesn't state is asked for in one line,
    with what to type. A calibrated monitor (`gtmbench calibrate`) watches with --detector monitor.json.

    Several logs, a folder or a pattern need --out, a folder for the results: a row a log, worst first
    (docs/how_to/fleet.md); or --history, where they are one aircraft's flights (docs/how_to/history.md). Without a log,
    --history FILE shows what stands in it.
    Logs in an object store are given by their addresses, such as s3://BUCKET/FOLDER.

    Exit code: 1 something failed, 0 nothing found, 3 can't tell, 2 bad input, or none of several could be watched.
    """
    from gtmbench.detectors.bank.composed import AUTO

    how |= {"detector": detector or AUTO, "healthy": tuple(healthy_part(text) for text in healthy)}
    keeping = keeping_of(history, aircraft_id, how, time_limit)
    files = [log for log in logs if isinstance(log, Path)]
    if keeping is not None:
        of_fleet = {"--out": out, "--jobs": jobs, "--resume": resume, "--scheduler": scheduler, "--tls": tls}
        refuse(of_fleet, "of a fleet; a history's flights follow each other")
        if len(files) < len(logs):
            raise InputError("--history is of flights that are files; fetch objects of a store first")
    if keeping is not None and (not logs or _is_fleet(logs, out)):
        refuse({"--list": listed, "--details": details}, "of one log")
        _check_outputs(record, reports, keeping.history, force=force)
        return monitor_history(keeping, files, record=record, reports=reports)
    if _is_fleet(logs, out):
        alone = {"--record": record, "--report": reports, "--list": listed, "--details": details, "--force": force}
        refuse(alone, "of one log; several logs have --out")
        from gtmbench.log.fleet import LIMIT_S, FleetQuestion

        watching = FleetQuestion(**how, limit_s=LIMIT_S if time_limit is None else time_limit)
        processes = 1 if jobs is None else whole("--jobs", jobs, 1, 1000)
        by = {"jobs": processes, "scheduler": scheduler, "tls": tls, "resume": resume}
        return _monitor_fleet(logs, watching, out, by)
    click.get_current_context().with_resource(limited(time_limit))
    of_several = {"--jobs": jobs, "--resume": resume, "--scheduler": scheduler, "--tls": tls}
    refuse(of_several, "of several logs; give --out, too")
    first = _as_file(logs[0])
    log = first if system is None else Path(f"{first}:{system}")
    _check_outputs(record, reports, log, force=force)
    if listed:
        return _list(log, how["mapping"], every=details)
    with shown_progress() as tell:
        from gtmbench.log.watch import watch_log  # a second in which the bar is there already

        if keeping is None:
            watched = watch_log(log, **how, progress=tell)
        else:
            keeping.enter(keeping.left(files))
            watched = keeping.watched(log, tell)
            keeping.add(watched)
        if details:
            watched = watched.with_names()
        tell("certificate")
        results = _results(watched) if is_json() else {}
        lines = [] if is_silent() else _lines(watched, details=details)
        tell("writing")
        _write(watched, record, reports)
        _keep_mapping(watched)
    if is_json():
        print_json(results)
    elif not is_silent():
        say([*lines, *written_lines(record, reports)])
    return watched.verdict.exit_code


def _as_file(log: Source) -> Path:
    """Return a log's file; an object is fetched, and kept until the command ends."""
    if isinstance(log, Path):
        return log
    from gtmbench.intake.objects import fetched

    return click.get_current_context().with_resource(fetched(log))


def _check_outputs(record: Path | None, reports: Sequence[Path], source: Path, *, force: bool) -> None:
    claim_file(record, force=force, option="--record", ends=[".rrd"], read=[source])
    for report in reports:
        claim_file(report, force=force, option="--report", ends=[".html", ".png"], read=[source])


def _list(log: Path, mapping: Sequence[str], *, every: bool) -> int:
    from gtmbench.intake.contents import log_contents
    from gtmbench.report.tables.log import contents_results
    from gtmbench.report.words.listing import listing_lines

    with shown_progress() as tell:
        tell("reading")
        contents = log_contents(log, mapping=mapping)

    if is_json():
        print_json(contents_results(contents))
    elif not is_silent():
        say(listing_lines(contents, screen_width()))
        if every:
            print_columns(contents.path, contents.columns)
    return 0


def _write(watched: WatchedLog, record: Path | None, reports: Sequence[Path]) -> None:
    for report in reports:
        with atomic_write(report) as aside:
            if report.suffix.lower() == ".png":
                from gtmbench.report.figures.log import write_log_figure

                write_log_figure(watched, aside)
            else:
                from gtmbench.report.page.flight import flight_page

                aside.write_text(flight_page(watched, command_line(_OUTPUTS)), encoding="utf-8")
    if record is not None:
        from gtmbench.report.recording.write import write_log_recording

        write_log_recording(watched, record)


def _keep_mapping(watched: WatchedLog) -> None:
    """Write how the columns were read, where ``--map`` names a file that isn't there."""
    for path in map_files(click.get_current_context().params["mapping"]):
        if not path.exists():
            from gtmbench.intake.flight_log import write_map_file

            write_map_file(watched.log.sources, path)


def _results(watched: WatchedLog) -> dict[str, Any]:
    from gtmbench.report.tables.log import log_results  # needs the simulator's version

    return log_results(watched)


def _lines(watched: WatchedLog, *, details: bool) -> list[str]:
    if details:
        from gtmbench.report.words.log import log_report

        return log_report(watched, screen_width())
    from gtmbench.report.words.verdict import summary_lines

    return summary_lines(watched, screen_width())


def _is_fleet(sources: Sequence[Source], out: Path | None) -> bool:
    """Whether more than a log is meant: several, a folder, a pattern, or a folder to write into."""
    if not sources:
        raise click.UsageError("Missing argument 'LOG|DIR|GLOB...'.")
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


def _monitor_fleet(sources: Sequence[Source], watching: FleetQuestion, out: Path | None, by: Mapping[str, Any]) -> int:
    """Watch logs into a folder, print a table, and return the exit code; `by`: who works, as `conduct` takes it."""
    from gtmbench.report.fleet import MEANING, RIGHT, fleet_results, fleet_table
    from gtmbench.report.fleet_report import FIGURE, REPORT, TABLE, written

    logs = watching.logs_of(sources)
    if out is None:
        raise InputError(f"logs found: {len(logs)}; their results go into a folder: give --out DIR")
    with shown_progress() as tell:
        parts = written(logs, watching, out, progress=tell, **by)
    results = fleet_results(parts)
    rows = results["logs"]

    def rest() -> Iterator[str]:
        names, cells = fleet_table(rows[:_MOST_ROWS], screen_width())
        print_table(f"{out}", names, cells, right=RIGHT)
        if len(rows) > _MOST_ROWS:
            yield f"{len(rows) - _MOST_ROWS} logs more stand in {out / REPORT}"
        yield from (MEANING[name] for name in names if name in MEANING)
        files = [name for name in (REPORT, TABLE, FIGURE) if is_file(out / name)]
        yield f"{', '.join(files)}, {len(rows)} parts: {out}/"

    return finish(results | {"out": str(out)}, rest)
