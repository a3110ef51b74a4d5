"""``gtmbench monitor``: a recorded flight, watched; or a fleet of them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gtmbench.checks import number, whole
from gtmbench.cli.detectors import detector_option
from gtmbench.cli.fleet import is_fleet, monitor_fleet
from gtmbench.cli.output import (
    attitude_option,
    claim_file,
    command_line,
    common_options,
    echo,
    map_option,
    print_columns,
    print_json,
    scope_options,
    screen_width,
)
from gtmbench.errors import InputError
from gtmbench.files.disk import LOGS, atomic_write, is_file, no_such
from gtmbench.jobs.progress import progress_bar
from gtmbench.jobs.time_limit import limited

if TYPE_CHECKING:
    from gtmbench.intake.contents import LogContents
    from gtmbench.study.log.watched import WatchedLog
    from gtmbench.values.record import Span


_OUTPUTS = ("record", "figure", "report", "save", "force", "details", "as_json", "quiet")  # that change no verdict
_DASHED = re.compile(r"\s*(\d+\.?\d*) *s? *(?:-|\.\.|,|to|:) *(\d+\.?\d*) *s?\s*")  # how else people write a span


@click.command("monitor")
@click.argument("logs", nargs=-1, required=True, metavar="LOG|DIR|GLOB...", type=click.Path(path_type=Path))
@map_option
@click.option("--system", metavar="N", help="The system that is meant, of a telemetry log of several.")
@detector_option("A bank or a detector is first calibrated on the healthy part.")
@click.option(
    "--identify",
    "healthy",
    multiple=True,
    metavar="T0:T1|LOG",
    help="The healthy part to calibrate on: a span of this log in seconds, or another log. With --detector it may be "
    "left out: then it is the first 40 % of this log's motion, 300 s at most. Without --detector, bank auto is "
    "calibrated.",
)
@click.option(
    "--inputs", metavar="p,q,beta", help="Instead of a detector: predict from these channels or pseudo inputs ..."
)
@click.option("--outputs", metavar="r", help="... predict these sensors.")
@click.option(
    "--look", default=0.5, show_default=True, help="With --inputs and --outputs: seconds to look back and ahead."
)
@click.option("--rate", type=float, help="Resample to this rate in Hz.  [default: the slowest channel's, 100 at most]")
@click.option(
    "--false-alarms-per-hour",
    "wanted",
    type=float,
    help="False alarm rate to calibrate for.  [default: 0.002 for a bank, 1 for --inputs and --outputs]",
)
@attitude_option
@scope_options
@click.option("--details", is_flag=True, help="Print everything that is known, after the verdict.")
@click.option(
    "--named", is_flag=True, help="Also report the size above which faults would have been named; takes some seconds."
)
@click.option("--record", type=click.Path(path_type=Path), help="Write a recording (.rrd) for `gtmbench view`.")
@click.option("--figure", type=click.Path(path_type=Path), help="Write a figure (.png).")
@click.option(
    "--report", type=click.Path(path_type=Path), help="Write a page (.html) to file with a ticket or to send by mail."
)
@click.option("--save", type=click.Path(path_type=Path), help="Write the monitor that was used (.json).")
@click.option("--list", "listed", is_flag=True, help="Only list the log's sensors and what can be watched.")
@click.option("--all", "every", is_flag=True, help="The same, with every column.")
@click.option("--force", is_flag=True, help="Write over existing files.")
@click.option(
    "--out", type=click.Path(path_type=Path), help="For several logs: folder for table, figure, report and parts."
)
@click.option("--jobs", type=int, help="For several logs: processes.  [default: 1]")
@click.option("--resume", is_flag=True, help="For several logs: continue the run in the folder.")
@click.option("--time-limit", type=float, help="Seconds allowed for a log.  [default: none; 900 for each of several]")
@common_options
def monitor_command(
    logs: tuple[Path, ...],
    mapping: tuple[str, ...],
    system: str | None,
    detector: str | None,
    calibrated: Path | None,
    healthy: tuple[str, ...],
    inputs: str | None,
    outputs: str | None,
    look: float,
    rate: float | None,
    wanted: float | None,
    attitude: str,
    judge: str | None,
    limits: tuple[str, ...],
    details: bool,
    named: bool,
    record: Path | None,
    figure: Path | None,
    report: Path | None,
    save: Path | None,
    listed: bool,
    every: bool,
    force: bool,
    out: Path | None,
    jobs: int | None,
    resume: bool,
    time_limit: float | None,
    as_json: bool,
    quiet: bool,
) -> int:
    """Watch a recorded flight: CSV, Parquet, PX4 ULog, ArduPilot, MAVLink telemetry, ROS bags, MCAP, MATLAB and more.

    Give a saved monitor, or a detector to calibrate on a healthy part; the rest is watched. With --identify alone, bank
    auto uses the relations that the log's channels allow. Without either, it lists what can be watched. A self-check
    comes first: a log that isn't what the monitor expects isn't watched, and the output says why and what to type.
    Exit code: 1 something failed, 0 nothing found, 3 can't tell, 2 bad input.

    Several logs, a folder or a pattern need --out, a folder for the results: a row a log, worst first. By default bank
    auto watches, identified on each log's own first part. Exit code: 1 any failed, 3 some can't tell, 0 nothing found,
    2 none could be watched (docs/how_to/fleet.md).
    """
    from gtmbench.detectors.bank.composed import AUTO

    if is_fleet(logs, out):
        alone = {
            "--named": named,
            "--record": record,
            "--figure": figure,
            "--report": report,
            "--save": save,
            "--list": listed,
            "--all": every,
            "--force": force,
        }
        _refuse(alone, "of one log; several logs have --out")
        watcher = _watcher(detector, calibrated, inputs, outputs, look, healthy) or AUTO
        from gtmbench.study.log.log_fleet import LIMIT_S, Watching

        watching = Watching(
            detector=watcher if detector is None or calibrated is not None else detector,  # a name is found anew
            healthy=tuple(healthy_part(text) for text in healthy),
            mapping=mapping,
            rate_hz=rate,
            false_alarms_per_hour=_wanted(wanted),
            attitude=attitude,
            judge=judge,
            limits=limits,
            limit_s=LIMIT_S if time_limit is None else time_limit,
        )
        processes = 1 if jobs is None else whole("--jobs", jobs, 1, 1000)
        return monitor_fleet(logs, watching, out, jobs=processes, resume=resume, as_json=as_json, quiet=quiet)
    click.get_current_context().with_resource(limited(time_limit))
    _refuse({"--jobs": jobs, "--resume": resume}, "of several logs; give --out, too")
    log = logs[0] if system is None else Path(f"{logs[0]}:{system}")
    for path, ending in ((record, ".rrd"), (figure, ".png"), (report, ".html"), (save, ".json")):
        if path is not None:
            _check_output(path, ending, log, force=force)
    monitor = _watcher(detector, calibrated, inputs, outputs, look, healthy)
    if monitor is None or listed or every:
        from gtmbench.intake.contents import log_contents

        with progress_bar(silent=as_json or quiet) as tell:
            tell("reading", None, None)
            contents = log_contents(log, mapping=mapping)
        if not quiet and (listed or every or not as_json):
            _list(contents, every=every, as_json=as_json)
        if listed or every:
            return 0
        raise _nothing_to_watch_with(contents)
    from gtmbench.study.log.watch import watch_log

    with progress_bar(silent=as_json or quiet) as tell:
        watched = watch_log(
            log,
            monitor,
            healthy=[healthy_part(text) for text in healthy],
            mapping=mapping,
            rate_hz=rate,
            false_alarms_per_hour=_wanted(wanted),
            attitude=attitude,
            judge=judge,
            limits=limits,
            progress=tell,
        )
        if named:
            watched = watched.with_names()
        tell("names" if named else "certificate", None, None)
        results = _results(watched) if as_json else {}
        lines = [] if as_json or quiet else _lines(watched, record, figure, report, save, details=details or named)
        tell("writing", None, None)
        _write(watched, record, figure, report, save)
        _keep_mapping(watched)
    if as_json:
        print_json(results)
    for line in lines:
        echo(line)
    return watched.verdict.exit_code


def _refuse(options: Mapping[str, object], why: str) -> None:
    """Refuse options that are for another number of logs."""
    for option, value in options.items():
        if value is not None and value is not False:
            raise InputError(f"{option} is {why}")


def _wanted(given: float | None) -> float | None:
    return None if given is None else number("--false-alarms-per-hour", given, 1e-9, 1e3)


def _check_output(path: Path, ending: str, log: Path, *, force: bool) -> None:
    option = {".rrd": "--record", ".png": "--figure", ".html": "--report", ".json": "--save"}[ending]
    if path.suffix.lower() != ending:
        raise InputError(f"{option} is '{path}'; its name ends in {ending}")
    if path.exists() and log.exists() and path.samefile(log):
        raise InputError(f"{option} is the log itself; give another name")
    claim_file(path, force=force, option=option)


def _watcher(
    detector: str | None,
    calibrated: Path | None,
    inputs: str | None,
    outputs: str | None,
    look: float,
    healthy: tuple[str, ...],
) -> Any | None:
    """Return what watches: a detector, a monitor, a bank, bank auto with --identify alone, or None without a word."""
    from gtmbench.detectors.bank.composed import AUTO
    from gtmbench.detectors.registry import find_detector

    if detector is not None and (inputs or outputs):
        raise InputError("both --detector and --inputs/--outputs are given; a bank has its own, so leave one out")
    if detector is not None:
        return find_detector(detector, calibrated=calibrated)
    if calibrated is not None:
        raise InputError(f"--calibrated {calibrated} holds the figures of a --detector of your own; name that, too")
    if not inputs and not outputs:
        return find_detector(AUTO) if healthy else None
    if not inputs or not outputs:
        missing = "--outputs" if inputs else "--inputs"
        raise InputError(
            f"{missing} is missing: give what is predicted (--outputs r) and what from (--inputs p,q,beta)"
        )
    from gtmbench.study.log.watch import bank_between

    split = [[name.strip() for name in given.split(",") if name.strip()] for given in (inputs, outputs)]
    return bank_between(*split, look_s=number("--look", look, 0.0, 60.0))


def healthy_part(text: str) -> Span | Path:
    """Return a span, open ends allowed (``:30``, ``40:``), or another log's path."""
    if is_file(Path(text)):
        return Path(text)
    asked = f"--identify is '{text}', and there is no such log; give a span in seconds, such as 0:30, or another log"
    if Path(text).suffix.lower() in LOGS:
        raise InputError(f"--identify: {no_such(Path(text))}")
    dashed = _DASHED.fullmatch(text)
    likely = ""
    if dashed and dashed[1] != dashed[2]:
        likely = "; did you mean {}:{}?".format(*sorted(dashed.groups(), key=float))
    start, _, end = map(str.strip, text.partition(":"))
    try:
        start_s, end_s = float(start or "-inf"), float(end or "inf")
    except ValueError:
        raise InputError(asked + likely) from None
    if ":" not in text:
        raise InputError(asked + (f"; did you mean 0:{start}?" if start_s > 0.0 else ""))
    if not start_s < end_s:  # so for NaN, too
        raise InputError(f"--identify is '{text}'; the start must come before the end{likely}")
    return start_s, end_s


def _list(contents: LogContents, *, every: bool, as_json: bool) -> None:
    """Print what a log holds and allows: a screen, or every column."""
    from gtmbench.report.tables.log import contents_results
    from gtmbench.report.words.listing import listing_lines

    if as_json:
        print_json(contents_results(contents))
        return
    for line in listing_lines(contents, screen_width()):
        echo(line)
    if every:
        print_columns(contents.path, contents.columns)


def _nothing_to_watch_with(contents: LogContents) -> InputError:
    """Return the error that ends the command where nobody said how to watch."""
    from gtmbench.detectors.bank.composed import AUTO, composed_bank
    from gtmbench.report.words.listing import banks_for

    channels, name = [*contents.usable, *contents.own_columns], contents.path.name
    doubts = [f"column '{column.name}' {column.why_not}" for column in contents.columns if column.why_not]
    if contents.no_time or not channels:
        why = contents.no_time or "; ".join(doubts) or "no column is known as a channel: --map CHANNEL=COLUMN:UNIT"
        return InputError(f"{name} can't be watched yet: {why}")
    ways = [f"--inputs ... --outputs ... of {', '.join(channels[:30])}"]
    if allowed := banks_for(contents.usable)[0]:
        ways.insert(0, f"--detector {' or '.join(allowed)}")
    with suppress(InputError):
        composed_bank(contents.usable)
        ways.insert(0, f"--identify T0:T1, a healthy part in s (bank {AUTO} learns from it and watches the rest)")
    return InputError(f"{name} can be watched; say how: {', or '.join(ways)}")


def _write(
    watched: WatchedLog, record: Path | None, figure: Path | None, report: Path | None, save: Path | None
) -> None:
    from gtmbench.detectors.protocol import is_ready

    if figure is not None:
        from gtmbench.report.figures.log import write_log_figure

        with atomic_write(figure) as aside:
            write_log_figure(watched, aside)
    if report is not None:
        from gtmbench.report.page.flight import flight_page

        with atomic_write(report) as aside:
            aside.write_text(flight_page(watched, command_line(_OUTPUTS)), encoding="utf-8")
    if record is not None:
        from gtmbench.report.recording.write import write_log_recording

        write_log_recording(watched, record)
    if save is not None and is_ready(watched.monitor):
        from gtmbench.detectors.monitor_file import save_monitor

        save_monitor(watched.monitor, save)


def _keep_mapping(watched: WatchedLog) -> None:
    """Write how the columns were read, where ``--map-file`` names a file that isn't there."""
    path = click.get_current_context().params.get("map_file")
    if path is not None and not path.exists():
        from gtmbench.intake.map_file import write_map_file

        write_map_file(watched.log.sources, path)


def _results(watched: WatchedLog) -> dict[str, Any]:
    from gtmbench.report.tables.log import log_results

    return log_results(watched)


def _lines(
    watched: WatchedLog,
    record: Path | None,
    figure: Path | None,
    report: Path | None,
    save: Path | None,
    *,
    details: bool,
) -> list[str]:
    from gtmbench.detectors.protocol import is_ready
    from gtmbench.report.words.log import log_report
    from gtmbench.report.words.verdict import summary_lines

    width = screen_width()
    lines = log_report(watched, width) if details else summary_lines(watched, width)
    for what, path in (("figure", figure), ("report", report), ("monitor", save)):
        if path is not None:
            was_made = path is not save or is_ready(watched.monitor)
            lines.append(f"{what}: {path}" if was_made else f"{what}: none was calibrated, {path} isn't written")
    if record is not None:
        lines.append(f"recording: {record}    look at it: gtmbench view {record}")
    return lines
