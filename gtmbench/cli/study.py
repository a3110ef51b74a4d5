"""Commands of the study: run, view."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gtmbench.checks import listed
from gtmbench.cli.options import chosen_faults, detector_option, import_option, is_typed, watchers_of
from gtmbench.cli.output import (
    PATH,
    HeadedCommand,
    check_screen,
    claim_folder,
    common_options,
    echo,
    finish,
    is_json,
    is_silent,
    print_json,
    print_table,
    say,
    shown_progress,
    write_new,
)
from gtmbench.errors import InputError
from gtmbench.files.folders import atomic_folder
from gtmbench.files.plain import envelope
from gtmbench.files.shipped import MAIN_JOB
from gtmbench.report.words.units import counted

if TYPE_CHECKING:
    from gtmbench.study.scenario import Scenario
    from gtmbench.study.trial import Study


_MOST_SEEDS = 10_000  # of a run


def _seeds(_context: click.Context, _option: click.Parameter, value: str | None) -> tuple[int, ...] | None:
    """Return a seed, or several: ``7``, ``1:20`` (both included)."""
    if value is None:
        return None
    first, colon, last = value.partition(":")
    try:
        seeds = range(int(first), int(last if colon else first) + 1)
    except ValueError:
        seeds = range(0)
    if not seeds or not 0 <= seeds[0] <= seeds[-1] < 2**31 or len(seeds) > _MOST_SEEDS:
        raise click.BadParameter(
            f"'{value}' is no seed; give a whole number from 0 on, or the first and the last of at most {_MOST_SEEDS}, "
            "such as 1:20"
        )
    return tuple(seeds)


@click.command("run", cls=HeadedCommand)
@click.argument("scenarios", nargs=-1, metavar="[SCENARIO.toml ...]")
@click.option("--out", default="study", show_default=True, type=PATH, help="Folder for the results.")
@detector_option(
    "The default is `dissertation`: the scenarios' own [operator] and [alarm]. A bank, or any other detector, is first "
    "calibrated on separate flights; then only watch_from_s and healthy_records of [alarm] are used.",
    multiple=True,
)
@import_option
@click.option(
    "--aircraft",
    metavar="NAME|FOLDER",
    help="Instead of the scenarios' aircraft: a name from `gtmbench list --all`, or an aircraft's folder.",
)
@click.option(
    "--sensors",
    metavar="ideal|chain",
    help="Instead of the scenarios' sensors. chain: the aircraft's own delays, filters and sample rates lie between "
    "motion and readings.",
)
@click.option(
    "--fault",
    "given",
    multiple=True,
    metavar="KIND:CHANNEL[:KEY=VALUE,...]",
    help="Instead of the scenarios' faults: this one, as bias:r:size=2. Repeat it for several in one trial.",
)
@click.option("--onset", type=float, metavar="SECONDS", help="When typed faults begin.")
@click.option(
    "--seed",
    "seeds",
    metavar="N|FIRST:LAST",
    callback=_seeds,
    help="Replace the scenarios' seed. For several (1:20, both included), each gets a folder.",
)
@click.option("--strict", is_flag=True, help="End with exit code 1 if a trial differs from its scenario's expectation.")
@click.option("--no-figures", "figures", is_flag=True, flag_value=False, default=True, help="Draw no figures.")
@click.option("--no-recording", "recording", is_flag=True, flag_value=False, default=True, help="Write no study.rrd.")
@click.option(
    "--new",
    type=PATH,
    metavar="NAME.toml",
    help="Fly nothing: write a scenario to edit, commented, with every key at its default.",
)
@click.option("--force", is_flag=True, help="Write into an existing folder: its files of the same names are replaced.")
@common_options
def run_command(
    scenarios: tuple[str, ...],
    out: Path,
    detectors: tuple[str, ...],
    aircraft: str | None,
    sensors: str | None,
    given: tuple[str, ...],
    onset: float | None,
    seeds: tuple[int, ...] | None,
    figures: bool,
    recording: bool,
    strict: bool,
    new: Path | None,
    force: bool,
) -> int:
    """Fly, break, watch and report: who finds which fault, and how fast.

    Example: gtmbench run jam --detector C --out first

    A scenario is a file, or a name from `gtmbench list`. Without one it runs the dissertation's study, every gyro
    broken in five ways. The folder gets results.json, trials.csv, figures and study.rrd, a recording for `gtmbench
    view`. Several detectors watch the same flight, and each detector and trial gets a row.
    """
    from gtmbench.report.tables.results import results, unexpected
    from gtmbench.report.words.study import study_verdict
    from gtmbench.study.run import run_study
    from gtmbench.study.scenario import flown_on, load_scenario, sensed_by

    if new is not None:
        return _write_scenario(new)
    claim_folder(out, force=force)
    loaded = [load_scenario(source) for source in scenarios or MAIN_JOB]
    if aircraft is not None:
        loaded = [flown_on(scenario, aircraft) for scenario in loaded]
    if sensors is not None:
        loaded = [sensed_by(scenario, sensors) for scenario in loaded]
    if given or onset is not None:
        loaded = _with_faults(loaded, given, onset)
    watching = watchers_of(detectors)
    parts = ["results", *["figures"] * figures, *["recording"] * recording]
    if seeds is not None and len(seeds) > 1:
        return _run_seeds(loaded, watching, seeds, out, parts, strict=strict)
    with shown_progress() as tell:
        study = run_study(
            loaded,
            detectors=watching,
            seed=None if seeds is None else seeds[0],
            progress=lambda step, done, total: tell(step, done, total + len(parts)),
        )
        with atomic_folder(out) as folder:
            _write(study, folder, parts, tell)
    code = int(strict and any(trial.unexpected for trial in study.trials))
    own = results(study)
    told = unexpected(own["trials"])
    result = envelope("run", study_verdict(study), own | {"out": str(out)}, exit_code=code, findings=told)

    def rest() -> None:
        _print_study(study, out, parts)
        if strict and not any(trial.expected for trial in study.trials):
            echo(f"--strict: the scenarios expect nothing of {', '.join(base.detector for base in study.baselines)}")

    return finish(result, rest)


def _write_scenario(target: Path) -> int:
    if target.suffix != ".toml":
        raise InputError(f"'{target}' should end in .toml, as {target.stem}.toml")
    write_new(target, (files("gtmbench.cli") / "template.toml").read_text(encoding="utf-8"))
    verdict = f"Wrote {target}; edit it, then run: gtmbench run {target}"
    return finish(envelope("run-new", verdict, {"out": str(target)}))


def _with_faults(scenarios: list[Scenario], given: tuple[str, ...], onset: float | None) -> list[Scenario]:
    """Return the first scenario, of a setup that all share, with one trial: of the faults that are typed."""
    from gtmbench.study.fault_tables import spec_of

    scenario_of = next((text for text in given if not is_typed(text)), None)
    if scenario_of is not None:
        raise InputError(f"--fault is '{scenario_of}'; give faults such as bias:r:size=2, or the scenario itself")
    first, faults = scenarios[0], chosen_faults(given, onset, None).faults
    return [replace(first, faults=(spec_of(faults, first.setup.duration_s),))]


def _write(study: Study, folder: Path, parts: Sequence[str], tell: Callable[[str], None]) -> None:
    from gtmbench.report.tables.results import write_results

    if "figures" in parts:
        from gtmbench.report.figures.study import write_figures

        tell("figures")
        write_figures(study, folder)
    if "recording" in parts:
        from gtmbench.report.recording.write import write_recording

        tell("recording")
        write_recording(study, folder / "study.rrd")
    tell("results")
    write_results(study, folder)


def _run_seeds(
    loaded: list[Scenario],
    watching: list[Any],
    seeds: tuple[int, ...],
    out: Path,
    parts: Sequence[str],
    *,
    strict: bool,
) -> int:
    """Run a study for every seed, each into a folder of its own, and put all of them into one table."""
    from gtmbench.report.tables.results import SeedTable, unexpected, write_tables
    from gtmbench.study.run import run_study

    table = SeedTable()
    with shown_progress() as tell, atomic_folder(out) as folder:
        for done, seed in enumerate(seeds):
            tell(f"seed {seed}", done, len(seeds))
            study = run_study(loaded, detectors=watching, seed=seed)
            own = folder / f"seed-{seed}"
            own.mkdir()
            _write(study, own, parts, lambda _step: None)
            table.add(seed, study)
        write_tables(table.results(), folder)
    told = unexpected(table.trials)
    code = int(strict and bool(told))

    def rest() -> None:
        say(table.summary_lines())
        columns, rows, right = table.rows()
        print_table(f"seeds {seeds[0]} to {seeds[-1]}", columns, rows, right=right)
        echo(f"one folder a seed, all trials in trials.csv: {out}/")

    whole = table.results() | {"out": str(out)}
    return finish(envelope("run-seeds", table.verdict(), whole, exit_code=code, findings=told), rest)


def _print_study(study: Study, out: Path, parts: Sequence[str]) -> None:
    from gtmbench.report.words.study import summary_lines, title, trial_rows

    columns, rows, right = trial_rows(study)
    print_table(f"{', '.join(map(title, study.baselines))}: {counted(len(rows), 'trial')}", columns, rows, right=right)
    say(summary_lines(study))
    look = f"    look at it: gtmbench view {out / 'study.rrd'}" if "recording" in parts else ""
    echo(f"{listed(parts)}: {out}/{look}")


@click.command("view", cls=HeadedCommand)
@click.argument("recording", metavar="RECORDING.rrd|FOLDER", type=PATH)
@click.option("--web", is_flag=True, help="Open it in the browser, for machines without a screen.")
@common_options
def view_command(recording: Path, web: bool) -> None:
    """Show a recording, or the one in a folder, in the rerun viewer: the flight in 3-D, its readings and verdicts.

    Example: gtmbench view first

    rerun's usage statistics are turned off first, for this user.
    """
    from gtmbench.report.recording.read import check_recording, recording_in, viewer_command, without_analytics

    recording = recording_in(recording)
    check_recording(recording)
    if not web:
        check_screen("--web")
    command = viewer_command([str(recording), *(["--web-viewer"] if web else [])])
    verdict, statistics = f"Showing {recording} in the rerun viewer.", without_analytics()
    if not is_silent():
        say([verdict, statistics])
    ended = subprocess.run(command, capture_output=is_silent(), check=False).returncode
    if ended:
        raise InputError(f"the rerun viewer ended with code {ended}; try --web")
    if is_json():
        print_json(envelope("view", verdict, {"recording": str(recording)}))
