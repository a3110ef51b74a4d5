"""The report of a campaign, such as `rivals`, and what README and docs say of it.

Run ``gtmbench campaign rivals`` first (half an hour of two cores), then ``python experiments/rivals.py FOLDER``: it
scores what stands in the folder into `reports/rivals`, the comparison as a page and every table of
``gtmbench campaign FOLDER --report md`` in `results.json`. `make figures` takes the table of
`docs/explanation/who_sees_what.md` from there. An unfinished campaign is refused.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import click

from gtmbench.errors import GtmbenchError, InputError
from gtmbench.files.plain import dumps
from gtmbench.files.writing import atomic_write
from gtmbench.jobs.parts import read_parts
from gtmbench.report.page.campaign import FORMATS, contents_of
from studies.tables import tables_in

OUT = Path(__file__).parent / "reports/rivals"


def written(folder: Path, out: Path) -> list[str]:
    """Write the report and the results of a finished campaign; return what was found, in sentences."""
    contents = contents_of(read_parts(folder), target_per_hour=None)
    if contents.done < contents.tasks:
        missing = contents.tasks - contents.done
        raise InputError(f"{folder} lacks {missing} of {contents.tasks} flights; finish it with --resume")
    short = FORMATS["table"](contents)
    (table,) = tables_in(short)
    results = {
        "script": "rivals.py",
        "command": f"gtmbench campaign {contents.campaign['name']}",
        "code": contents.facts["versions"],
        "summary": contents.summary,
        "table": table,
        "notes": short.strip().split("\n\n")[1:],
        "tables": tables_in(FORMATS["md"](contents)),
    }
    found = "".join(f"- {line}\n" for line in contents.verdict)
    page = f"# {contents.title}\n\n{contents.summary}.\n\n{found}\n{short}\nMore tables: `results.json`.\n"
    out.mkdir(parents=True, exist_ok=True)
    for name, text in (("report.md", page), ("results.json", dumps(results, indent=1) + "\n")):
        with atomic_write(out / name) as path:
            path.write_text(text, encoding="utf-8")
    return list(contents.verdict)


def main() -> int:
    """Write the report of a campaign's folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="of the finished campaign")
    parser.add_argument("--out", type=Path, default=OUT, help="folder of the report")
    given = parser.parse_args()
    try:
        for line in written(given.folder, given.out):
            click.echo(line)
    except (GtmbenchError, OSError) as error:
        parser.error(str(error))
    return 0


if __name__ == "__main__":
    sys.exit(main())
