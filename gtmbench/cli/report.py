"""``gtmbench campaign --report``: what a campaign found, as a page, Markdown or JSON."""

from __future__ import annotations

from pathlib import Path

from gtmbench.checks import number
from gtmbench.cli.output import claim_file, echo, print_json
from gtmbench.errors import InputError
from gtmbench.files.disk import atomic_write
from gtmbench.report.tables.envelope import envelope

FORMATS = {"html": "report.html", "md": "report.md", "json": "report.json", "table": "table.md"}  # default names


def report_campaign(
    folder: Path,
    form: str,
    out: Path | None,
    *,
    target: float | None,
    deadline: float | None,
    force: bool,
    as_json: bool,
    quiet: bool,
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
    with atomic_write(path) as aside:
        aside.write_text(WRITERS[form](contents), encoding="utf-8")
    if as_json:
        verdict, findings = first_and_rest(contents.verdict)
        print_json(envelope("campaign-report", verdict, {"out": str(path)}, findings=findings))
    elif not quiet:
        for line in contents.verdict:
            echo(line)
        echo(f"report: {path}")
    return 0


def _path(folder: Path, out: Path | None, form: str) -> Path:
    """Return where a report goes: into the folder, or into another, or the file that is named."""
    name = FORMATS[form]
    if out is None or out.is_dir():
        return (folder if out is None else out) / name
    if out.suffix != Path(name).suffix:
        raise InputError(f"--out is {out}, and --report {form} is a {Path(name).suffix}; give one that ends so")
    return out
