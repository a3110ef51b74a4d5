"""``gtmbench run --monitor``: scenarios watched by a calibrated monitor, or by a bank that is calibrated first."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from gtmbench.cli.output import echo, print_json, print_table, progress_bar
from gtmbench.files import folder_aside
from gtmbench.study.scenario import Scenario

if TYPE_CHECKING:
    from gtmbench.study.monitored import MonitoredStudy


def run_with_monitor(
    loaded: list[Scenario], source: str, out: Path, *, seed: int | None, as_json: bool, quiet: bool
) -> None:
    """Run scenarios, write what came of them into a folder, and print it."""
    from gtmbench.study.monitored import find_monitor, run_monitored

    monitor = find_monitor(source)
    with progress_bar(silent=as_json or quiet) as tell:
        # three more are written below
        study = run_monitored(loaded, monitor, seed=seed, progress=lambda step, done, of: tell(step, done, of + 3))
        with folder_aside(out) as folder:
            _write(study, folder, lambda step: tell(step, None, None))
    if as_json:
        from gtmbench.report.monitor_results import monitored_results

        print_json(monitored_results(study) | {"out": str(out)})
    elif not quiet:
        _print_study(study, out)


def _write(study: MonitoredStudy, folder: Path, tell: Callable[[str], None]) -> None:
    from gtmbench.report.monitor_figures import write_monitored_figures
    from gtmbench.report.monitor_recording import write_monitored_recording
    from gtmbench.report.monitor_results import write_monitored_results

    tell("figures")
    write_monitored_figures(study, folder)
    tell("recording")
    write_monitored_recording(study, folder / "study.rrd")
    tell("results")
    write_monitored_results(study, folder)


def _print_study(study: MonitoredStudy, out: Path) -> None:
    from gtmbench.report.monitor_text import monitored_rows, summary_lines

    columns, rows, right = monitored_rows(study)
    print_table(f"bank {study.baseline.monitor.bank.name}: {len(rows)} trials", columns, rows, right=right)
    for line in summary_lines(study):
        echo(line)
    echo(f"results, figures and recording: {out}/    look at it: gtmbench view {out / 'study.rrd'}")
