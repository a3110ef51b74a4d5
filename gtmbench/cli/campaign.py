"""``gtmbench campaign``: scenarios times axes, on as many processes and machines as there are."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gtmbench.checks import whole
from gtmbench.cli.command import HeadedCommand
from gtmbench.cli.detectors import detector_option, import_option
from gtmbench.cli.output import check_cluster_options, cluster_options, common_options, echo, print_json, print_table
from gtmbench.cli.report import FORMATS, report_campaign
from gtmbench.errors import InputError
from gtmbench.files.folders import atomic_folder
from gtmbench.jobs.progress import progress_bar
from gtmbench.report.tables.envelope import envelope

if TYPE_CHECKING:
    from gtmbench.jobs.parts import Parts, Shard


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
    type=click.Path(path_type=Path),
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
@click.option("--jobs", type=int, help="Processes on this machine.  [default: all cores]")
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
    jobs: int | None,
    shard: tuple[int, int] | None,
    scheduler: str | None,
    tls: Path | None,
    resume: bool,
    dry_run: bool,
    yes: bool,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> int:
    """Compare detectors on many flights: every flight of a campaign, every fault on it, every detector.

    Example: gtmbench campaign ci --dry-run

    A task is a flight, and each finished task is a Parquet file in the folder. After any interruption --resume
    continues and gives the same table. When all tasks are finished, results.json and trials.csv are written
    (docs/how_to/campaigns.md).

    Exit codes: 0 success; 2 bad input, or an interruption; 3 some trials failed, and their rows say why.
    """
    if form is not None:
        how = {"target": target, "deadline": deadline}
        return report_campaign(Path(source), form, out, **how, force=force, as_json=as_json, quiet=quiet)
    _check_alone({"--false-alarms-per-hour": target, "--deadline": deadline, "--force": force or None})
    from gtmbench.jobs.parts import Shard
    from gtmbench.report.campaign import campaign_results, plan_facts, plan_lines, plan_verdict, write_campaign
    from gtmbench.study.campaign.conduct import check_size, conduct
    from gtmbench.study.campaign.plan import load_campaign
    from gtmbench.study.campaign.watchers import named

    campaign = load_campaign(source, detectors=detectors)
    processes = whole("--jobs", os.cpu_count() or 1 if jobs is None else jobs, 1, 1000)
    check_cluster_options(scheduler, tls)
    if dry_run:
        plan = plan_facts(campaign, named(campaign).names, processes)
        check_size(campaign, len(plan["detectors"]), yes=True)
        if as_json:
            print_json(envelope("campaign-plan", plan_verdict(plan), plan))
        elif not quiet:
            for line in plan_lines(plan):
                echo(line)
        return 0
    folder = Path(campaign.name) if out is None else out
    own = None if shard is None else Shard(*shard)
    with progress_bar(silent=as_json or quiet) as tell:
        parts = conduct(
            campaign,
            folder,
            jobs=processes,
            shard=own,
            scheduler=scheduler,
            tls=tls,
            resume=resume,
            yes=yes,
            progress=tell,
        )
    if parts.todo():
        return _print_share(parts, own, as_json=as_json, quiet=quiet)
    with atomic_folder(folder) as aside:
        write_campaign(parts, aside)
    results = campaign_results(parts)
    if as_json:
        print_json(results | {"out": str(folder)})
    elif not quiet:
        _print_results(results, folder)
    return int(results["exit_code"])


def _check_alone(of_report: Mapping[str, object]) -> None:
    """Refuse what only --report has."""
    for option, value in of_report.items():
        if value is not None:
            raise InputError(f"{option} is of --report; add that, or leave it out")


def _print_share(parts: Parts, shard: Shard | None, *, as_json: bool, quiet: bool) -> int:
    from gtmbench.study.campaign.conduct import flights_of

    (flights, done), share = flights_of(parts), str(shard)
    of = f"{done} of {flights} flights stand in {parts.folder}/"
    verdict = f"Shard {share} is done: {of}, --resume collects them."
    if as_json:
        own = {"out": str(parts.folder), "shard": share, "tasks": flights, "tasks_done": done}
        print_json(envelope("campaign-shard", verdict, own))
    elif not quiet:
        echo(verdict)
    return 0


def _print_results(results: dict[str, Any], folder: Path) -> None:
    from gtmbench.report.campaign import fault_rows, summary_lines

    echo(results["verdict"])
    columns, rows, right = fault_rows(results)
    if rows:
        print_table(f"{results['campaign']}: {results['title']}", columns, rows, right=right)
    for line in summary_lines(results):
        echo(line)
    echo(f"results.json, trials.csv, {results['parts']} parts: {folder}/")
