"""``gtmbench benchmark``: gtmbench-2, whose flights and rules are frozen."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gtmbench.cli.command import PATH, HeadedCommand, common_options
from gtmbench.cli.options import cluster_options, detector_option, jobs_option
from gtmbench.cli.output import echo, finish, is_silent, print_table, shown_progress
from gtmbench.errors import InputError
from gtmbench.files.plain import attributes, envelope
from gtmbench.files.writing import atomic_write, write_text

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from gtmbench.study.benchmark.definition import Definition
    from gtmbench.study.benchmark.judge import Row


@click.command("benchmark", cls=HeadedCommand)
@click.option("--quick", is_flag=True, help="A small version, with flights of its own: minutes instead of hours.")
@click.option("--export", "export", type=PATH, metavar="DIR", help="Write the flights, without labels.")
@click.option(
    "--score",
    "entries",
    multiple=True,
    type=PATH,
    metavar="DIR",
    help="Judge the score files, or the alarms.csv, in a folder. Repeat it for several.",
)
@detector_option("It learns on the benchmark's flights.  [default: ours, unless --score is given]", multiple=True)
@click.option(
    "--split",
    type=click.Choice(["test", "development"]),
    default="test",
    show_default=True,
    help="Which flights are judged; look at development while you build.",
)
@click.option(
    "--private-seed",
    type=PATH,
    metavar="FILE",
    help="Judge a private split, whose seeds follow from what the file holds.",
)
@click.option("--csv/--parquet", "as_csv", default=False, help="With --export: the format.  [default: parquet]")
@click.option("--out", type=PATH, help="Folder of the table.  [default: the benchmark's name]")
@click.option("--archive", type=PATH, metavar="FILE", help="Write the run as one ZIP file, to be deposited.")
@jobs_option
@cluster_options
@click.option("--any-versions", is_flag=True, help="Run with other versions of jsbsim, numpy or scipy: not gtmbench-2.")
@common_options
def benchmark_command(
    quick: bool,
    export: Path | None,
    entries: tuple[Path, ...],
    detectors: tuple[str, ...],
    split: str,
    private_seed: Path | None,
    as_csv: bool,
    out: Path | None,
    archive: Path | None,
    jobs: int,
    scheduler: str | None,
    tls: Path | None,
    any_versions: bool,
) -> None:
    """Judge detectors on gtmbench-2: frozen flights, one rule for thresholds, one table.

    Example: gtmbench benchmark --quick --detector C

    Without options our own detectors enter. A detector in Python enters with --detector, any other by files: --export
    writes the flights, and --score judges what you make of them (docs/how_to/benchmark.md). A run that was stopped goes
    on where it was.
    """
    from gtmbench.study.benchmark.definition import PRIVATE, load_definition, with_secret
    from gtmbench.study.benchmark.export import export as export_flights

    definition = load_definition(quick=quick)
    if not any_versions:
        definition.check_versions()
    if private_seed is not None:
        definition, split = with_secret(definition, private_seed), PRIVATE
    if scheduler is not None and export is not None:
        raise InputError("--export writes flights here, without --scheduler; use --jobs")
    if as_csv and export is None:
        raise InputError("--csv is the format of flights that are written; give --export DIR, too")
    if export is not None:
        if entries or detectors:
            raise InputError("--export writes flights and judges nobody; leave --score and --detector for another run")
        with shown_progress() as tell:
            flights = export_flights(
                definition, split, export, suffix=".csv" if as_csv else ".parquet", processes=jobs, progress=tell
            )
        verdict = f"Wrote {len(flights)} flights of {definition.name}, split {split}: {export}."
        own = {"out": str(export), "flights": len(flights)}
        _finish("benchmark-export", definition, split, verdict, own)
        return
    folder = Path(definition.name) if out is None else out
    from gtmbench.jobs.workers import Workers
    from gtmbench.study.benchmark.detectors import DETECTORS
    from gtmbench.study.benchmark.run import run_benchmark
    from gtmbench.study.watchers import resolved

    watching = detectors or (() if entries else DETECTORS)
    named = resolved([*watching]) if watching else {}
    workers = Workers(processes=jobs, scheduler=scheduler, tls=tls)
    with shown_progress() as tell:
        rows = run_benchmark(
            definition, split, folder, detectors=named, entries=entries, workers=workers, progress=tell
        )
    _write(rows, definition, split, folder, _command(quick, detectors, entries, split, private_seed))
    verdict = f"Judged {len(rows)} rows on {definition.name}, split {split}: {folder}/report.md."
    if archive is not None:
        from gtmbench.study.benchmark.export import archive as write_archive

        verdict += f" {write_archive(definition, folder, archive)} files are in {archive}."
    own = {"out": str(folder), "rows": _short(rows)}
    _finish("benchmark", definition, split, verdict, own, partial(_print, rows))


def _command(
    quick: bool, detectors: Sequence[str], entries: Sequence[Path], split: str, private_seed: Path | None
) -> str:
    # names alone: where files lie on this machine is nobody's business
    words = ["gtmbench benchmark", *["--quick"] * quick, *(f"--detector {Path(each).name}" for each in detectors)]
    words += [f"--score {each.name}" for each in entries]
    if private_seed is not None:
        words.append("--private-seed FILE")
    elif split != "test":
        words.append(f"--split {split}")
    return " ".join(words)


def _write(rows: Sequence[Row], definition: Definition, split: str, folder: Path, command: str) -> None:
    from gtmbench.files.plain import plain
    from gtmbench.report.benchmark import benchmark_curves, benchmark_page, benchmark_results, citation

    results = plain(benchmark_results(rows, definition, split))
    texts = {
        "report.md": benchmark_page(rows, definition, split, command) + "\n![curves](curves.png)\n",
        "results.json": json.dumps(results, indent=1) + "\n",
        "CITATION.cff": citation(definition, split),
    }
    for name, text in texts.items():
        write_text(folder / name, text)
    with atomic_write(folder / "curves.png") as aside:
        benchmark_curves(rows, definition).savefig(aside, dpi=110, format="png")


def _short(rows: Sequence[Row]) -> list[dict[str, Any]]:
    return [
        {
            "name": row.name,
            "quickness": None if row.quickness is None else row.quickness.value,
            "interval": None if row.quickness is None else [row.quickness.low, row.quickness.high],
            **attributes(row, "flights", "detected", "right", "wrong", "either", "median_delay_s"),
            "false_alarms": row.false_alarms.events,
            "healthy_hours": row.false_alarms.hours,
        }
        for row in rows
    ]


def _print(rows: Sequence[Row]) -> None:
    from gtmbench.report.benchmark import table

    frame = table(rows)
    cells = [[str(value) for value in row] for row in frame.to_numpy(dtype=object)]
    print_table("by quickness", list(frame.columns), cells, right=[name for name in frame.columns if name != "entry"])


def _finish(
    name: str,
    definition: Definition,
    split: str,
    verdict: str,
    own: dict[str, Any],
    rest: Callable[[], None] | None = None,
) -> None:
    from gtmbench.report.benchmark import about

    if definition.differing and not is_silent():
        echo(f"not {definition.name}: {definition.differing}")
    finish(envelope(name, verdict, about(definition, split) | own), rest)
