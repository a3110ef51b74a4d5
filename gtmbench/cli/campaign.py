"""``gtmbench campaign``: scenarios times axes, and what was found; ``gtmbench benchmark``: gtmbench-2, frozen."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gtmbench.checks import number
from gtmbench.cli.options import cluster_options, detector_option, import_option, jobs_option, refuse
from gtmbench.cli.output import (
    PATH,
    HeadedCommand,
    claim_file,
    common_options,
    echo,
    finish,
    is_silent,
    print_table,
    shown_progress,
)
from gtmbench.errors import InputError
from gtmbench.files.folders import atomic_folder
from gtmbench.files.plain import attributes, envelope
from gtmbench.files.writing import atomic_write, write_text

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from gtmbench.jobs.parts import Parts, Shard
    from gtmbench.study.benchmark.definition import Definition
    from gtmbench.study.benchmark.judge import Row

FORMATS = {"html": "report.html", "md": "report.md", "json": "report.json", "table": "table.md"}  # default names


def _shard(_context: click.Context, _option: click.Parameter, value: str | None) -> tuple[int, int] | None:
    """Return a shard's number and how many there are: ``3/40``."""
    if value is None:
        return None
    number, _, of = value.partition("/")
    if not (number.isascii() and number.isdigit() and of.isascii() and of.isdigit() and len(value) < 20):
        raise click.BadParameter(f"'{value[:40]}' is no shard; give its number and how many there are, such as 3/40")
    if not 1 <= int(number) <= int(of):
        raise click.BadParameter(f"'{value}': shards of {of} are numbered from 1 to {of}")
    return int(number), int(of)


@click.command("campaign", cls=HeadedCommand)
@click.argument("source", metavar="NAME|CAMPAIGN.toml|DIR")
@click.option(
    "--out",
    type=PATH,
    help="Folder for the parts and results.  [default: the name]  With --report the file.  [default: in DIR]",
)
@click.option(
    "--report",
    "form",
    type=click.Choice(list(FORMATS)),
    help="Fly nothing: score what stands in the folder DIR, and write it as one page that needs no network (html), as "
    "Markdown, as data, or as a short table for a page of your own.",
)
@click.option(
    "--false-alarms-per-hour",
    "target",
    type=float,
    help="With --report: a detector that certainly raises more gets no score.  [default: the campaign's, or 1]",
)
@click.option(
    "--deadline", type=float, help="With --report: seconds within which a fault should be detected.  [default: 10]"
)
@detector_option("It watches in addition to the campaign's own.", multiple=True)
@import_option
@jobs_option
@click.option("--shard", callback=_shard, metavar="I/N", help="Run only the I-th of N equal shares, for a Slurm array.")
@cluster_options
@click.option("--resume", is_flag=True, help="Continue the run in the folder.")
@click.option("--dry-run", is_flag=True, help="Print the plan and fly nothing.")
@click.option("--yes", is_flag=True, help="Confirm more than ten million trials.")
@click.option("--force", is_flag=True, help="With --report: write over the file that --out names.")
@common_options
def campaign_command(
    source: str,
    out: Path | None,
    form: str | None,
    target: float | None,
    deadline: float | None,
    detectors: tuple[str, ...],
    jobs: int,
    shard: tuple[int, int] | None,
    dry_run: bool,
    force: bool,
    **how: Any,  # else is as `conduct` takes it
) -> int:
    """Compare detectors on many flights: every flight of a campaign, every fault on it, every detector.

    Example: gtmbench campaign ci --dry-run

    A task is a flight, and each finished task is a Parquet file in the folder. After any interruption --resume
    continues and gives the same table. When all tasks are finished, results.json and trials.csv are written
    (docs/how_to/campaigns.md).

    Exit codes: 0 success; 2 bad input, or an interruption; 3 some trials failed, and their rows say why.
    """
    if form is not None:
        return _report(Path(source), form, out, target=target, deadline=deadline, force=force)
    of_report = {"--false-alarms-per-hour": target, "--deadline": deadline, "--force": force}
    refuse(of_report, "of --report; add that, or leave it out")
    from gtmbench.jobs.parts import Shard
    from gtmbench.report.campaign import campaign_results, plan_facts, plan_lines, plan_verdict, write_campaign
    from gtmbench.study.campaign.conduct import check_size, conduct, named
    from gtmbench.study.campaign.plan import load_campaign

    campaign = load_campaign(source, detectors=detectors)
    if dry_run:
        plan = plan_facts(campaign, named(campaign).names, jobs)
        check_size(campaign, len(plan["detectors"]), yes=True)
        return finish(envelope("campaign-plan", plan_verdict(plan), plan), lambda: plan_lines(plan))
    folder = Path(campaign.name) if out is None else out
    own = None if shard is None else Shard(*shard)
    with shown_progress() as tell:
        parts = conduct(campaign, folder, jobs=jobs, shard=own, progress=tell, **how)
    if parts.todo():
        return _finish_share(parts, own)
    with atomic_folder(folder) as aside:
        write_campaign(parts, aside)
    results = campaign_results(parts)
    return finish(results | {"out": str(folder)}, partial(_rest, results, folder))


def _finish_share(parts: Parts, shard: Shard | None) -> int:
    from gtmbench.study.campaign.conduct import flights_of

    (flights, done), share = flights_of(parts), str(shard)
    verdict = f"Shard {share} is done: {done} of {flights} flights stand in {parts.folder}/, --resume collects them."
    own = {"out": str(parts.folder), "shard": share, "tasks": flights, "tasks_done": done}
    return finish(envelope("campaign-shard", verdict, own))


def _rest(results: dict[str, Any], folder: Path) -> list[str]:
    from gtmbench.report.campaign import fault_rows, summary_lines

    columns, rows, right = fault_rows(results)
    if rows:
        print_table(f"{results['campaign']}: {results['title']}", columns, rows, right=right)
    return [*summary_lines(results), f"results.json, trials.csv, {results['parts']} parts: {folder}/"]


def _report(
    folder: Path, form: str, out: Path | None, *, target: float | None, deadline: float | None, force: bool
) -> int:
    """Score what stands in a campaign's folder, and write it in a format; an unfinished one as far as it has come."""
    from gtmbench.jobs.parts import read_parts
    from gtmbench.report.page.campaign import FORMATS as WRITERS
    from gtmbench.report.page.campaign import contents_of
    from gtmbench.report.tables.scores import first_and_rest
    from gtmbench.study.scores.scoring import DEADLINE_S

    path = _path(folder, out, form)
    parts = read_parts(folder)
    claim_file(path, force=force or out is None)
    contents = contents_of(
        parts,
        target_per_hour=None if target is None else number("--false-alarms-per-hour", target, 0.0, above=True),
        deadline_s=DEADLINE_S if deadline is None else number("--deadline", deadline, 0.0, above=True),
    )
    write_text(path, WRITERS[form](contents))
    verdict, findings = first_and_rest(contents.verdict)
    result = envelope("campaign-report", verdict, {"out": str(path)}, findings=findings)
    return finish(result, lambda: [*contents.verdict[1:], f"report: {path}"])


def _path(folder: Path, out: Path | None, form: str) -> Path:
    """Return where a report goes: into the folder, or into another, or the file that is named."""
    name = FORMATS[form]
    if out is None or out.is_dir():
        return (folder if out is None else out) / name
    if out.suffix != Path(name).suffix:
        raise InputError(f"--out is {out}, and --report {form} is a {Path(name).suffix}; give one that ends so")
    return out


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
    from gtmbench.study.benchmark.run import export as export_flights

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
        from gtmbench.study.benchmark.run import archive as write_archive

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
