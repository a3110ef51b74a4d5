"""``gtmbench monitor``: a recorded flight, watched; or a fleet of them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gtmbench.checks import number, whole
from gtmbench.cli.detectors import detector_option
from gtmbench.cli.fleet import is_fleet, monitor_fleet
from gtmbench.cli.output import (
    attitude_option,
    claim_file,
    common_options,
    echo,
    map_option,
    print_columns,
    print_json,
    screen_width,
)
from gtmbench.errors import InputError
from gtmbench.files import atomic_write, is_file
from gtmbench.progress import progress_bar

if TYPE_CHECKING:
    from gtmbench.intake.contents import LogContents
    from gtmbench.record import Span
    from gtmbench.study.log.watched import WatchedLog


_DASHED = re.compile(r"\s*(\d+\.?\d*) *(?:-|\.\.|,|to) *(\d+\.?\d*) *s?\s*")  # how else people write a span


@click.command("monitor")
@click.argument("logs", nargs=-1, required=True, metavar="LOG|DIR|GLOB...", type=click.Path(path_type=Path))
@map_option
@detector_option("A bank or a detector is calibrated on what is healthy first.")
@click.option(
    "--identify",
    "healthy",
    multiple=True,
    metavar="T0:T1|LOG",
    help="What is healthy, to calibrate on: a span of this log in seconds, or another log. Without it a detector takes "
    "this log's first 40 %, 300 s at most; without a detector it is of bank auto.",
)
@click.option(
    "--inputs", metavar="p,q,beta", help="Instead of a detector: predict from these channels or pseudo inputs ..."
)
@click.option("--outputs", metavar="r", help="... predict these sensors.")
@click.option("--look", default=0.5, show_default=True, help="How far they look back and ahead, in seconds.")
@click.option("--rate", type=float, help="Resample to so many Hz.  [default: the slowest channel's, 100 at most]")
@click.option(
    "--false-alarms-per-hour",
    "wanted",
    type=float,
    help="Of what is identified here.  [default: 0.002 of a bank, 1 of --inputs and --outputs]",
)
@attitude_option
@click.option("--named", is_flag=True, help="Say from which size on faults would have been named, too: seconds.")
@click.option("--record", type=click.Path(path_type=Path), help="Write a recording (.rrd) for `gtmbench view`.")
@click.option("--figure", type=click.Path(path_type=Path), help="Write a figure (.png).")
@click.option("--save", type=click.Path(path_type=Path), help="Write the monitor that was used (.json).")
@click.option("--list", "listed", is_flag=True, help="Only say what the log holds, and what can be watched.")
@click.option("--all", "every", is_flag=True, help="The same, with every column.")
@click.option("--force", is_flag=True, help="Write over existing files.")
@click.option("--out", type=click.Path(path_type=Path), help="Of several logs: folder of table, figure, report, parts.")
@click.option("--jobs", type=int, help="Of several logs: processes.  [default: 1]")
@click.option("--resume", is_flag=True, help="Of several logs: go on with what stands in the folder.")
@click.option("--time-limit", type=float, help="Of several logs: seconds that one may take.  [default: 900]")
@common_options
def monitor_command(
    logs: tuple[Path, ...],
    mapping: tuple[str, ...],
    detector: str | None,
    calibrated: Path | None,
    healthy: tuple[str, ...],
    inputs: str | None,
    outputs: str | None,
    look: float,
    rate: float | None,
    wanted: float | None,
    attitude: str,
    named: bool,
    record: Path | None,
    figure: Path | None,
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
    """Watch a recorded flight: CSV, Parquet, PX4 ULog, ArduPilot DataFlash, MCAP.

    With a monitor that is ready, or a detector calibrated on a healthy part; the rest is watched. With --identify alone
    by bank auto, the relations that the log's channels allow. Without either, it lists what the log allows. First comes
    a self-check: a log that isn't what the monitor expects isn't watched, and why, and what to type, is said. Exit
    code: 1 something failed, 0 nothing found, 3 can't tell, 2 bad input.

    Several logs, a folder or a pattern are watched into a folder, --out: a row a log, worst first, without a word by
    bank auto, each identified on its own first part. Exit code: 1 any failed, 3 some can't be told, 2 none could be
    read (docs/how_to/fleet.md).
    """
    from gtmbench.detectors.bank.composed import AUTO

    if is_fleet(logs, out):
        alone = {
            "--named": named,
            "--record": record,
            "--figure": figure,
            "--save": save,
            "--list": listed,
            "--all": every,
            "--force": force,
        }
        _refuse(alone, "of one log; several logs have --out")
        watcher = _watcher(detector, calibrated, inputs, outputs, look, healthy) or AUTO
        from gtmbench.study.log.fleet import LIMIT_S, Watching

        watching = Watching(
            detector=watcher if detector is None or calibrated is not None else detector,  # a name is found anew
            healthy=tuple(healthy_part(text) for text in healthy),
            mapping=mapping,
            rate_hz=rate,
            false_alarms_per_hour=_wanted(wanted),
            attitude=attitude,
            limit_s=LIMIT_S if time_limit is None else time_limit,
        )
        processes = 1 if jobs is None else whole("--jobs", jobs, 1, 1000)
        return monitor_fleet(logs, watching, out, jobs=processes, resume=resume, as_json=as_json, quiet=quiet)
    _refuse({"--jobs": jobs, "--resume": resume, "--time-limit": time_limit}, "of several logs; give --out, too")
    log = logs[0]
    for path, ending in ((record, ".rrd"), (figure, ".png"), (save, ".json")):
        if path is not None:
            _check_output(path, ending, log, force=force)
    monitor = _watcher(detector, calibrated, inputs, outputs, look, healthy)
    if monitor is None or listed or every:
        from gtmbench.intake.contents import log_contents

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
            progress=tell,
        )
        if named:
            tell("names", None, None)
            watched = watched.with_names()
        tell("writing", None, None)
        _write(watched, record, figure, save)
    if as_json:
        from gtmbench.report.tables.log import log_results

        print_json(log_results(watched))
    elif not quiet:
        _print(watched, record, figure, save)
    return int(watched.outcome)


def _refuse(options: Mapping[str, object], why: str) -> None:
    """Refuse options that are for another number of logs."""
    for option, value in options.items():
        if value is not None and value is not False:
            raise InputError(f"{option} is {why}")


def _wanted(given: float | None) -> float | None:
    return None if given is None else number("--false-alarms-per-hour", given, 1e-9, 1e3)


def _check_output(path: Path, ending: str, log: Path, *, force: bool) -> None:
    option = {".rrd": "--record", ".png": "--figure", ".json": "--save"}[ending]
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
    if ":" not in text:
        dashed = _DASHED.fullmatch(text)
        likely = f"; did you mean {dashed[1]}:{dashed[2]}?" if dashed else ""
        raise InputError(
            f"--identify is '{text}', and there is no such log; give a span in seconds, such as 0:30, or another log"
            f"{likely}"
        )
    start, end = (bound.strip() for bound in text.split(":", 1))
    try:
        start_s, end_s = float(start or "-inf"), float(end or "inf")
    except ValueError:
        raise InputError(f"--identify is '{text}'; give a span in seconds, such as 0:30, or another log") from None
    if not start_s < end_s:  # so for NaN, too
        raise InputError(f"--identify is '{text}'; the start must come before the end")
    return start_s, end_s


def _list(contents: LogContents, *, every: bool, as_json: bool) -> None:
    """Print what a log holds and allows: a screen, or every column."""
    from gtmbench.report.tables.log import contents_results
    from gtmbench.report.words.listing import listing_lines

    if as_json:
        print_json(contents_results(contents))
        return
    if every:
        print_columns(contents.path, contents.columns)
    for line in listing_lines(contents, screen_width()):
        echo(line)


def _nothing_to_watch_with(contents: LogContents) -> InputError:
    """Return the error that ends the command where nobody said how to watch."""
    from gtmbench.detectors.bank.composed import AUTO, composed_bank
    from gtmbench.report.words.listing import banks_for

    channels = [*contents.usable, *contents.own_columns]
    if not channels:
        why = contents.no_time or f"no column becomes a channel of {contents.path.name}"
        return InputError(f"nothing was said about how to watch it, and as it is nothing could: {why}")
    allowed, _ = banks_for(contents.usable)
    named = f"--detector {' or '.join(allowed)}, " if allowed else ""
    try:
        composed_bank(contents.usable)
        banks = f"give --identify T0:T1, what of it is healthy (bank {AUTO} watches the rest), {named}or"
    except InputError:
        banks = f"give {named}or" if allowed else "no bank's channels are there; give"
    return InputError(
        f"nothing was said about how to watch {contents.path.name}: {banks} --inputs ... --outputs ... of "
        f"{', '.join(channels[:30])}"
    )


def _write(watched: WatchedLog, record: Path | None, figure: Path | None, save: Path | None) -> None:
    from gtmbench.detectors.protocol import is_ready

    if figure is not None:
        from gtmbench.report.figures.log import write_log_figure

        with atomic_write(figure) as aside:
            write_log_figure(watched, aside)
    if record is not None:
        from gtmbench.report.recording.write import write_log_recording

        write_log_recording(watched, record)
    if save is not None and is_ready(watched.monitor):
        from gtmbench.detectors.files import save_monitor

        save_monitor(watched.monitor, save)


def _print(watched: WatchedLog, record: Path | None, figure: Path | None, save: Path | None) -> None:
    from gtmbench.detectors.protocol import is_ready
    from gtmbench.report.words.log import log_report

    for line in log_report(watched):
        echo(line)
    for what, path in (("figure", figure), ("monitor", save)):
        if path is not None:
            was_made = path is figure or is_ready(watched.monitor)
            echo(f"{what}: {path}" if was_made else f"{what}: none was calibrated, {path} isn't written")
    if record is not None:
        echo(f"recording: {record}    look at it: gtmbench view {record}")
