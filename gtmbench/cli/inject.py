"""``gtmbench inject``: a recorded flight, broken; ``gtmbench score``: one that was, as trials of whoever watches."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gtmbench.cli.options import (
    ChosenFaults,
    chosen_faults,
    detector_option,
    fault_options,
    healthy_option,
    healthy_part,
    import_option,
    map_option,
    numbered,
    rate_option,
    scenario_trials,
    scope_options,
)
from gtmbench.cli.output import (
    PATH,
    HeadedCommand,
    claim_file,
    common_options,
    finish,
    print_columns,
    print_table,
    shown_progress,
)
from gtmbench.errors import InputError
from gtmbench.files.plain import envelope
from gtmbench.report.words.units import counted
from gtmbench.values.channels import ATTITUDE

if TYPE_CHECKING:
    from gtmbench.faults.fault import Fault
    from gtmbench.log.breaking.bent_attitude import AttitudeFollowing
    from gtmbench.log.breaking.inject import ChangedColumn
    from gtmbench.log.truth.score import Scored, ScoredLog
    from gtmbench.study.fault_tables import FaultSpec

_MOST_NAMED = 12  # columns


@click.command("inject", cls=HeadedCommand)
@click.argument("log", type=PATH)
@fault_options("The fault: typed in place, or a scenario's [[faults]].", required=True)
@map_option
@click.option(
    "--attitude",
    metavar="auto|own|follows[:SECONDS]",
    default="auto",
    show_default=True,
    help="The effect of a gyro's fault on phi, theta and psi. follows: an estimator with this time constant computes "
    "them from the broken gyros. own: none. auto: follows if the gyros drive the log's attitude, which is assumed "
    "unless something shows otherwise.",
)
@click.option(
    "--time-constant-s",
    type=float,
    help="The estimator's time constant.  [default: the log's own if accelerometers show it, else 5 s]",
)
@click.option("--out", type=PATH, help="The broken log to write, in the same format; a .csv where that is only read.")
@click.option("--list", "listed", is_flag=True, help="List the log's columns and the scenario's trials; write nothing.")
@import_option
@click.option("--force", is_flag=True, help="Write over an existing file.")
@common_options
def inject_command(
    log: Path,
    given: tuple[str, ...],
    onset: float | None,
    trial: int | None,
    mapping: tuple[str, ...],
    attitude: str,
    time_constant_s: float | None,
    out: Path | None,
    listed: bool,
    force: bool,
) -> None:
    """Break a sensor in a recorded flight: write the log again as it would be had the sensor failed.

    Example: gtmbench inject flight.csv --fault bias:q:size=3 --onset 60 --out broken.csv

    It reads any format that `gtmbench monitor` reads; the faults are typed in place, or a scenario's trial.

    A CSV or a Parquet table stays as it is but for the fault. Of other formats the channels are written, as a CSV
    that `gtmbench monitor` reads as it is, and the output says what that leaves out. If the gyros drive the attitude,
    as in most logs, it follows a gyro's fault.

    Onsets are on the log's clock, as `gtmbench monitor` shows it. Figures are in the channels' units, whatever the
    log's are.
    """
    if listed:
        _list(log, scenario_trials(given))
        return
    if out is None:
        raise InputError("--out is missing; name the broken log to write")
    from gtmbench.intake.read import read_log
    from gtmbench.log.breaking.bent_attitude import following_in_log
    from gtmbench.log.breaking.inject import becomes_table, inject_log, left_out

    chosen = chosen_faults(given, onset, trial)
    read = read_log(log)
    broken = {name for fault in chosen.faults for name in fault.changes}
    following = following_in_log(read, broken, mapping, attitude=attitude, time_constant_s=time_constant_s)
    changing = {*broken, *(ATTITUDE if following.estimator else ())}
    as_table = becomes_table(read, changing, mapping)
    claim_file(out, force=force, ends=[".csv" if as_table else read.path.suffix.lower()], read=[read.path])
    changed = inject_log(read, out, chosen.faults, mapping=mapping, attitude=following.estimator or "own")
    without = left_out(read, mapping) if as_table else ()
    samples = sum(column.changed for column in changed)
    verdict = f"Wrote {out}: {chosen.text} changed {counted(samples, 'sample')}."
    own = _summary(log, out, chosen, changed, following) | {"left_out": without}
    finish(envelope("inject", verdict, own), lambda: _lines(out, chosen.faults, changed, following, without))


def _list(log: Path, trials: Sequence[FaultSpec]) -> None:
    from gtmbench.intake.contents import log_columns

    columns = log_columns(log)
    verdict = f"{log} has {counted(len(columns), 'column')}, and the scenario {counted(len(trials), 'trial')}."

    def rest() -> list[str]:
        print_columns(log, columns)
        return [f"trial {line}" for line in numbered(trials)]

    own = {"columns": columns, "trials": [trial.text for trial in trials]}
    finish(envelope("inject-list", verdict, own), rest)


def _summary(
    log: Path, out: Path, chosen: ChosenFaults, changed: Sequence[ChangedColumn], following: AttitudeFollowing
) -> dict[str, object]:
    from gtmbench.study.trial import fault_row

    return {
        "log": str(log),
        "out": str(out),
        "scenario": chosen.source,
        "trial": chosen.trial,
        "faults": [fault_row(fault) for fault in chosen.faults],
        "columns": changed,
        "attitude": {
            "follows": following.estimator is not None,
            "time_constant_s": None if following.estimator is None else following.estimator.time_constant_s,
            "time_constant": following.time_constant or None,
            "why": following.why,
        },
    }


def _lines(
    out: Path,
    faults: Sequence[Fault],
    changed: Sequence[ChangedColumn],
    following: AttitudeFollowing,
    without: Sequence[str],
) -> Iterator[str]:
    from gtmbench.report.words.judgement import fault_text
    from gtmbench.report.words.units import first_few

    for fault in faults:
        until = "to the end" if fault.duration_s is None else f"to {fault.onset_s + fault.duration_s:g} s"
        yield f"{fault_text(fault)}, from {fault.onset_s:g} s {until}"
    yield following.text
    for column in changed:
        when = "" if column.first_s is None else f", from {column.first_s:.10g} to {column.last_s:.10g} s"
        yield f"{column.channel}, column '{column.column}': {column.changed} of {column.samples} samples changed{when}"
    if without:
        yield f"left out, for this format is only read: {first_few(without, _MOST_NAMED)}"
    yield f"broken log: {out}    watch it: gtmbench monitor {out}"


_COLUMNS = ("failure", "found after (s)", "we said", "", "autopilot after (s)", "autopilot said")


@click.command("score", cls=HeadedCommand)
@click.argument("log", type=PATH)
@map_option
@detector_option("The default, auto, uses the relations that the log's channels allow.")
@import_option
@healthy_option("[default: the log before the first failure, 300 s at most]")
@rate_option
@scope_options
@common_options
def score_command(
    log: Path,
    detector: str | None,
    healthy: tuple[str, ...],
    **how: Any,  # else is as `score_log` takes it
) -> int:
    """Score monitor and autopilot on the injected failures that a log records: who found them, and when.

    Example: gtmbench score flight.bin

    It reads PX4's failure injection and changes of ArduPilot's SIM_GYR... parameters, so SITL and bench flights become
    trials. Exit code: 1 something failed, 0 nothing found, 3 can't tell, 2 bad input or no such failure.
    """
    from gtmbench.detectors.bank.composed import AUTO
    from gtmbench.detectors.registry import find_detector
    from gtmbench.log.truth.score import score_log
    from gtmbench.report.tables.log import score_results

    with shown_progress() as tell:
        parts = [healthy_part(text) for text in healthy]
        scores = score_log(log, find_detector(detector or AUTO), healthy=parts, progress=tell, **how)
    return finish(score_results(scores), partial(_scored_lines, log, scores))


def _scored_lines(log: Path, scores: ScoredLog) -> list[str]:
    from gtmbench.report.words.others import score_report
    from gtmbench.report.words.verdict import verdict_text

    print_table(log.name, _COLUMNS, [_scored_row(row) for row in scores.rows], right=[_COLUMNS[1], _COLUMNS[4]])
    learnt = [f"learnt from {start_s:.2f} to {end_s:.2f} s" for start_s, end_s in scores.watched.identified_s]
    return [*score_report(scores), *learnt, verdict_text(scores.watched)]


def _scored_row(row: Scored) -> list[str]:
    from gtmbench.report.words.others import injection_text

    after = "" if row.named_delay_s is None else f" after {row.named_delay_s:.1f} s"
    said = f"{row.said}{after}" if row.said else "missed"
    return [
        injection_text(row.injection),
        "-" if row.delay_s is None else f"{row.delay_s:.2f}",
        row.alarm.verdict if row.alarm is not None else "nothing",
        f"not scored: {row.why_not}" if row.why_not else said,
        "-" if row.word_delay_s is None else f"{row.word_delay_s:.2f}",
        row.word.text if row.word is not None else "nothing",
    ]
