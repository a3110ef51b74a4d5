"""``gtmbench score``: a log with failures that were injected, as trials of monitor and autopilot."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gtmbench.cli.command import PATH, HeadedCommand, common_options
from gtmbench.cli.options import (
    detector_option,
    healthy_option,
    healthy_part,
    import_option,
    map_option,
    rate_option,
    scope_options,
)
from gtmbench.cli.output import finish, print_table, shown_progress

if TYPE_CHECKING:
    from gtmbench.log.truth.score import Scored, ScoredLog

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
    return finish(score_results(scores), partial(_rest, log, scores))


def _rest(log: Path, scores: ScoredLog) -> list[str]:
    from gtmbench.report.words.autopilot import score_report
    from gtmbench.report.words.verdict import verdict_text

    print_table(log.name, _COLUMNS, [_row(row) for row in scores.rows], right=[_COLUMNS[1], _COLUMNS[4]])
    learnt = [f"learnt from {start_s:.2f} to {end_s:.2f} s" for start_s, end_s in scores.watched.identified_s]
    return [*score_report(scores), *learnt, verdict_text(scores.watched)]


def _row(row: Scored) -> list[str]:
    from gtmbench.report.words.autopilot import injection_text

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
