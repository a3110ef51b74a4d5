"""Commands of the study: run, view, new."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

import click

from gtmbench.channels import unit_of
from gtmbench.cli.monitored import run_with_monitor
from gtmbench.cli.output import common_options, echo, print_json, print_table, progress_bar
from gtmbench.errors import InputError
from gtmbench.files import check_file, check_folder, folder_aside, shipped_scenarios, written_aside
from gtmbench.report.read_recording import check_recording
from gtmbench.study.run import run_study
from gtmbench.study.scenario import Scenario, load_scenario
from gtmbench.study.trial import Study

# `python -m rerun_cli` ends with code 0 whatever happened
_RERUN = (sys.executable, "-c", "import sys; from rerun_cli.__main__ import main; sys.exit(main())")


@click.command("run")
@click.argument("scenarios", nargs=-1, metavar="[SCENARIO.toml ...]")
@click.option(
    "--out", default="study", show_default=True, type=click.Path(path_type=Path), help="Folder of the results."
)
@click.option(
    "--monitor",
    metavar="FILE|BANK",
    help="Watch with this instead: a monitor of `gtmbench calibrate` (.json), or a bank (a name such as C, or a "
    ".toml), calibrated first on flights of its own. Of the scenarios' [operator] and [alarm], only watch_from_s and "
    "healthy_records are used then.",
)
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), help="Instead of the scenarios' own.")
@click.option("--force", is_flag=True, help="Write into an existing folder: its files of the same names are replaced.")
@common_options
def run_command(
    scenarios: tuple[str, ...],
    out: Path,
    monitor: str | None,
    seed: int | None,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Fly, break, watch and report: scenario files, or names of `gtmbench list`.

    Without a scenario: the dissertation's study, every gyro broken in five ways. Into the folder go results.json,
    trials.csv, figures and study.rrd, a recording for `gtmbench view`.
    """
    check_folder(out, force=force)
    loaded = [load_scenario(source) for source in scenarios or shipped_scenarios()]
    if monitor is not None:
        run_with_monitor(loaded, monitor, out, seed=seed, as_json=as_json, quiet=quiet)
        return
    study = _run(loaded, seed, out, silent=as_json or quiet)
    if as_json:
        from gtmbench.report.results import results

        print_json(results(study) | {"out": str(out)})
    elif not quiet:
        _print_study(study, out)


def _run(loaded: list[Scenario], seed: int | None, out: Path, *, silent: bool) -> Study:
    with progress_bar(silent=silent) as tell:
        # three more are written below
        study = run_study(loaded, seed=seed, progress=lambda step, done, total: tell(step, done, total + 3))
        with folder_aside(out) as folder:
            _write(study, folder, lambda step: tell(step, None, None))
    return study


def _write(study: Study, folder: Path, tell: Callable[[str], None]) -> None:
    from gtmbench.report.figures import write_figures
    from gtmbench.report.recording import write_recording
    from gtmbench.report.results import write_results

    tell("figures")
    write_figures(study, folder)
    tell("recording")
    write_recording(study, folder / "study.rrd")
    tell("results")
    write_results(study, folder)


def _print_study(study: Study, out: Path) -> None:
    from gtmbench.detectors.bank.tails import rate_bound
    from gtmbench.report.text import trial_rows

    columns, rows, right = trial_rows(study)
    print_table(f"{study.baseline.operator.name}: {len(rows)} trials", columns, rows, right=right)
    baseline = study.baseline
    found = sum(trial.detected for trial in study.trials)
    bound = rate_bound(baseline.false_alarms, baseline.healthy_hours)
    limit = "" if bound is None else f" (at most {bound:.1f} an hour at 95 % confidence)"
    echo(f"detected: {found} of {len(study.trials)}")
    echo(f"false alarms: {baseline.false_alarms}; healthy flight watched: {baseline.healthy_hours:.2f} h{limit}")
    unit = unit_of(baseline.operator.outputs[0])
    armed = "never armed" if baseline.armed_s is None else f"armed at {baseline.armed_s:g} s"
    echo(f"threshold: {baseline.threshold:.4g} {unit}; {armed}, when the norm first stood at or below it")
    norm = baseline.norm
    window_s = (norm.window + 1) * norm.sample_period_s
    echo(f"an alarm at k is dated (k + w + d) Ts: look-ahead {norm.look_ahead_s:g} s, window {window_s:g} s")
    echo(f"results, figures and recording: {out}/    look at it: gtmbench view {out / 'study.rrd'}")


@click.command("view")
@click.argument("recording", type=click.Path(path_type=Path))
@click.option("--web", is_flag=True, help="In the browser instead of a window: for machines without a screen.")
@common_options
def view_command(recording: Path, web: bool, as_json: bool, quiet: bool) -> None:
    """Open a recording (.rrd) in the rerun viewer."""
    check_recording(recording)
    if not web and sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise InputError("there is no screen here (neither DISPLAY nor WAYLAND_DISPLAY is set); use --web")
    options = ["--bind", "127.0.0.1", *(["--web-viewer"] if web else [])]  # rerun would listen on every interface
    ended = subprocess.run([*_RERUN, str(recording), *options], capture_output=as_json or quiet, check=False).returncode
    if ended:
        raise InputError(f"the rerun viewer ended with code {ended}; try --web")
    if as_json:
        print_json({"recording": str(recording)})


@click.command("new")
@click.argument("name", metavar="NAME.toml", type=click.Path(path_type=Path))
@common_options
def new_command(name: Path, as_json: bool, quiet: bool) -> None:
    """Write a commented scenario to edit, every key at its default."""
    if name.suffix != ".toml":
        raise InputError(f"'{name}' should end in .toml")
    if name.exists():
        raise InputError(f"{name} exists; give another name")
    check_file(name, force=False)
    with written_aside(name) as aside:
        aside.write_text((files("gtmbench.cli") / "template.toml").read_text(encoding="utf-8"), encoding="utf-8")
    if as_json:
        print_json({"scenario": str(name)})
    elif not quiet:
        echo(f"{name}: edit it, then: gtmbench run {name}")
