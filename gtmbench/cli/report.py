"""``gtmbench report``: what a campaign found, as a page, Markdown or JSON."""

from __future__ import annotations

from pathlib import Path

import click

from gtmbench.checks import number
from gtmbench.cli.output import claim_file, common_options, echo, print_json
from gtmbench.errors import InputError
from gtmbench.files.disk import atomic_write
from gtmbench.report.tables.envelope import envelope

_FORMATS = {"html": "report.html", "md": "report.md", "json": "report.json", "table": "table.md"}  # default names


@click.command("report")
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
@click.option(
    "--out", type=click.Path(path_type=Path), help="A file, or a folder for it.  [default: report.html in DIR]"
)
@click.option(
    "--format",
    "form",
    type=click.Choice(list(_FORMATS)),
    help="The format.  [default: as --out ends, or html]",
)
@click.option(
    "--false-alarms-per-hour",
    "target",
    type=float,
    help="A detector that certainly raises more gets no score.  [default: the campaign's, or 1]",
)
@click.option("--deadline", type=float, help="Seconds within which a fault should be detected.  [default: 10]")
@click.option("--force", is_flag=True, help="Write over the file that --out names.")
@common_options
def report_command(
    folder: Path,
    out: Path | None,
    form: str | None,
    target: float | None,
    deadline: float | None,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> int:
    """Score the results in a campaign's folder, and write them as one page that needs no network.

    An unfinished campaign is scored on its flights so far. docs/how_to/scores.md explains the figures.
    """
    from gtmbench.jobs.parts import read_parts
    from gtmbench.report.page.sections import contents_of
    from gtmbench.report.page.write import FORMATS
    from gtmbench.report.tables.scores import first_and_rest
    from gtmbench.study.scores.scoring import DEADLINE_S

    suffix = "" if out is None or out.is_dir() else out.suffix.lstrip(".")
    if form is None and suffix and suffix not in _FORMATS:
        raise InputError(f"--out is {out}, which says no format; end it in .html, .md or .json, or give --format")
    form = form or suffix or "html"
    path = _path(folder, out, form)
    parts = read_parts(folder)
    claim_file(path, force=force or out is None)
    contents = contents_of(
        parts,
        target_per_hour=None if target is None else number("--false-alarms-per-hour", target, 0.0, above=True),
        deadline_s=DEADLINE_S if deadline is None else number("--deadline", deadline, 0.0, above=True),
    )
    with atomic_write(path) as aside:
        aside.write_text(FORMATS[form](contents), encoding="utf-8")
    if as_json:
        verdict, findings = first_and_rest(contents.verdict)
        print_json(envelope("report", verdict, {"out": str(path)}, findings=findings))
    elif not quiet:
        for line in contents.verdict:
            echo(line)
        echo(f"report: {path}")
    return 0


def _path(folder: Path, out: Path | None, form: str) -> Path:
    if out is None:
        return folder / _FORMATS[form]
    return out / _FORMATS[form] if out.is_dir() else out
