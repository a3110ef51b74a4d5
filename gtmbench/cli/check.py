"""``gtmbench check``: the gate of a team's CI."""

from __future__ import annotations

import time
import tomllib
import traceback
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gtmbench.cli.options import detector_option, import_option, refuse
from gtmbench.cli.output import (
    PATH,
    HeadedCommand,
    claim_file,
    common_options,
    finish,
    is_json,
    is_silent,
    print_table,
    say,
    shown_progress,
)
from gtmbench.errors import GtmbenchError, InputError
from gtmbench.files.shipped import MAIN_JOB, is_installed, shipped_baselines

if TYPE_CHECKING:
    from gtmbench.check.baseline import Reference
    from gtmbench.check.compare import Pair
    from gtmbench.check.figures import FigureGroup
    from gtmbench.detectors.protocol import Detector, Monitor


@click.command("check", cls=HeadedCommand)
@click.argument("baseline", default="dissertation", metavar="[BASELINE.toml]")
@click.option("--update", is_flag=True, help="Write the figures of this run into the baseline and show the changes.")
@click.option(
    "--scenario",
    "scenarios",
    multiple=True,
    metavar="NAME|FILE",
    help="With --update, for a new baseline: the scenario to run. Repeat it for several, which share a flight.  "
    "[default: the dissertation's five]",
)
@click.option(
    "--logs",
    multiple=True,
    metavar="FOLDER|LOG",
    help="With --update, for a new baseline: recorded flights instead of scenarios. Repeat it for several.",
)
@detector_option("Give it with --update for a new baseline, or if the baseline names a detector of your own.")
@import_option
@click.option("--junit", type=PATH, help="Also write a JUnit XML file for a CI.")
@common_options
def check_command(
    baseline: str,
    update: bool,
    scenarios: tuple[str, ...],
    logs: tuple[str, ...],
    detector: str | None,
    junit: Path | None,
) -> int:
    """Hold detectors in CI: run a baseline's scenarios, and fail if a figure is worse than in the baseline.

    Example: gtmbench check

    Without BASELINE.toml it uses the shipped one for the dissertation's study (bank-C also ships). It compares the
    healthy residual's peak, RMS and greatest value in every 10 s, the threshold, its margin, and the false alarms. For
    every trial it compares detection, detection delay and peak ratio, and with a bank also isolation and kind.

    Recorded flights are held the same way: `gtmbench check logs.toml --update --logs FOLDER` records the verdict on
    every sensor of every log, and `gtmbench check logs.toml` fails where one changes (docs/how_to/my_logs_in_ci.md).

    A baseline is a small TOML file to commit. Make one with `gtmbench check mine.toml --update`, edit its scenarios and
    tolerances, and renew it with the same command: comments and tolerances stay.

    Exit codes: 0 no figure is worse (better ones are reported), 1 a regression (a line for each figure: was, is,
    allowed), 2 it couldn't run, or the baseline lacks a figure of the run.
    """
    from gtmbench.check.baseline import find_baseline

    path = find_baseline(baseline)
    if update:
        if junit is not None:
            raise InputError("--junit writes a comparison, and --update makes none; leave out one of them")
        return _update(path, scenarios, logs, detector)
    refuse({"--scenario": scenarios, "--logs": logs}, "for a new baseline, with --update; others name their own")
    return _check(path, detector, junit)


def _check(path: Path, detector: str | None, junit: Path | None) -> int:
    from gtmbench.check.baseline import read_reference
    from gtmbench.check.check import check, check_lines, check_results, regression_line, write_junit

    claim_file(junit, force=True, option="--junit", ends=[".xml"])
    reference = read_reference(path)
    reference.check_recorded()
    watcher = _watcher(reference, detector)
    began = time.monotonic()
    held = check(reference, _run(reference, watcher))
    if junit is not None:
        write_junit(held, junit, took_s=time.monotonic() - began)
    code = finish(check_results(held), lambda: check_lines(held)[1:])
    if is_silent() and not is_json():
        say(map(regression_line, held.regressions))
    return code


def _watcher(reference: Reference, detector: str | None) -> Detector | Monitor | None:
    """Return what goes by the name that a baseline states, where the command line brings it."""
    from gtmbench.detectors.registry import find_detector

    if detector is None:
        return None
    watcher = find_detector(detector)
    if reference.detector != watcher.name:
        raise InputError(
            f"{reference.path} names {reference.detector or 'no detector'}, and --detector {detector} is "
            f"'{watcher.name}'; leave --detector out, or state detector = \"{watcher.name}\" there"
        )
    return watcher


def _update(path: Path, scenarios: tuple[str, ...], logs: tuple[str, ...], detector: str | None) -> int:
    from gtmbench.check.baseline import new_baseline, read_reference, reference_of, write_figures
    from gtmbench.check.check import update_results
    from gtmbench.check.compare import pairs
    from gtmbench.detectors.registry import find_detector, is_python

    _check_target(path)
    if not path.exists():
        python = detector is not None and is_python(detector)
        named = find_detector(str(detector)).name if python else detector
        if scenarios and logs:
            raise InputError("--scenario and --logs are both given; make a baseline of each")
        text = new_baseline(path, scenarios=scenarios or MAIN_JOB, logs=logs, detector=named)
        reference = reference_of(path, tomllib.loads(text))
    elif scenarios or logs:
        raise InputError(f"{path} exists and names its own {'scenarios' if scenarios else 'logs'}; edit them there")
    else:
        reference, text = read_reference(path), path.read_text(encoding="utf-8")
        python = True
    watcher = _watcher(reference, detector) if python else None
    groups = _run(reference, watcher)
    write_figures(path, text, seed=reference.seed, groups=groups)
    changes = list(pairs(reference.recorded, groups))
    return finish(update_results(reference, changes), partial(_print_changes, reference, changes))


def _check_target(path: Path) -> None:
    """Refuse, before the run, to write where that can't be meant."""
    if path.suffix != ".toml":
        raise InputError(f"'{path}' should end in .toml, as {path.stem}.toml")
    if is_installed() and path.resolve() in {shipped.resolve() for shipped in shipped_baselines().values()}:
        raise InputError(
            f"baseline {path.stem} is part of the installed package, which isn't written into; copy it ({path}), or "
            "make your own: gtmbench check mine.toml --update"
        )
    claim_file(path, force=True)


def _run(reference: Reference, watcher: Detector | Monitor | None) -> tuple[FigureGroup, ...]:
    """Run what a baseline names. A bug in it is no regression, so it mustn't end with a traceback's exit code, 1."""
    from gtmbench.check.check import run_reference

    try:
        with shown_progress() as tell:
            return run_reference(reference, detector=watcher, progress=tell)
    except (GtmbenchError, OSError, MemoryError):
        raise
    except Exception as error:
        traceback.print_exc()
        raise GtmbenchError(f"the run failed: {type(error).__name__}: {error}") from error


def _print_changes(reference: Reference, changes: list[Pair]) -> None:
    from gtmbench.check.check import changed_rows

    rows = changed_rows(changes) if reference.recorded else []
    if rows:
        print_table(f"{reference.path}: what changes", ["figure", "was", "is", "unit"], rows, right=["was", "is"])
