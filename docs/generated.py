"""Pages that are made of the code, so that they can't lag behind it: every public name, channels, theory, reports.

They go into ``docs/reference/generated``, which git doesn't keep.
"""

from __future__ import annotations

import pkgutil
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import gtmbench as gb
import gtmbench.testing
import theory
from gtmbench.api import __all__ as public

ROOT = Path(__file__).parents[1]
HERE = ROOT / "docs/reference/generated"
ROOMS = {  # where a name is defined: what one does there
    "values": "Records",
    "files": "Records",
    "bench": "Fly and measure",
    "faults": "Break",
    "method": "Identify and predict",
    "detectors": "Watch and explain",
    "engine": "Watch and explain",
    "intake": "Read flight logs",
    "study": "Run studies, watch logs",
    "log": "Run studies, watch logs",
    "verdict": "Run studies, watch logs",
    "link": "Watch a flight while it flies",
    "export": "Take a monitor on board",
    "report": "Recordings",
    "errors": "Errors and warnings",
}
REPORTS = {  # pages of the repository that these pages link to; each becomes a page here
    path.relative_to(ROOT).as_posix(): f"report_{path.parent.name}"
    for path in (*sorted((ROOT / "experiments/reports").glob("*/report.md")), ROOT / "aircraft/gtm/README.md")
}
OF_PROJECT = {"CONTRIBUTING.md": "contributing", "SECURITY.md": "security"}  # the same
TABLES = {"CHANNELS": "values", "PSEUDO_INPUTS": "method"}  # values, which can't say where they come from


def room(name: str) -> str:
    """Return what one does with a public name."""
    module = "" if name in TABLES else getattr(gb, name).__module__
    return ROOMS[TABLES.get(name) or module.split(".")[1]]


def summary(module: str, names: Iterable[str]) -> Iterator[str]:
    """Yield a table of names, each with a page of its own."""
    yield from (f".. currentmodule:: {module}", "", ".. autosummary::", "   :toctree: .", "   :nosignatures:", "")
    yield from (f"   {name}" for name in names)
    yield ""


def title(text: str, line: str = "=") -> Iterator[str]:
    """Yield a heading."""
    yield from (text, line * len(text), "")


def names_page() -> Iterator[str]:
    """Yield the page of everything public, by what one does with it."""
    yield from title("Every public name")
    yield from ("Names of ``import gtmbench as gb``, and of ``gtmbench.testing`` for tests of your own detector.", "")
    for heading in dict.fromkeys(ROOMS.values()):
        yield from title(heading, "-")
        yield from summary("gtmbench", (name for name in public if room(name) == heading))
    yield from title("Test with pytest", "-")
    yield from summary("gtmbench.testing", gtmbench.testing.__all__)


def theory_page() -> Iterator[str]:
    """Yield the page of the theory's modules."""
    yield from title("Theory, beside the package")
    yield from (
        "``experiments/theory`` of a checkout, which the dissertation's scripts share; ``pip install -e '.[theory]'``.",
        "",
    )
    modules = sorted(found.name for found in pkgutil.iter_modules(theory.__path__))
    yield from summary("theory", modules)


def channels_page() -> Iterator[str]:
    """Yield the channel table."""
    yield from title("Channels")
    yield from (*(gtmbench.values.channels.__doc__ or "").strip().splitlines(), "")
    heads = ("name", "unit", "column of a log", "meaning", "noise of the T2's sensor", "JSBSim's property")
    yield from (".. list-table::", "   :header-rows: 1", "")
    rows = (
        (
            f"``{item.name}``",
            item.unit,
            f"``{item.header}``",
            item.meaning,
            f"{item.noise:g}" if item.noise else "",
            f"``{item.jsbsim}``",
        )
        for item in gb.CHANNELS.values()
    )
    for cells in (heads, *rows):
        yield from (f"   {'  ' if column else '* '}- {cell}".rstrip() for column, cell in enumerate(cells))
    yield from ("", "Pseudo inputs", "-------------", "")
    yield from (
        "A sensor's reading by kinematics, computed from other channels; any operator may take it (`gtmbench.derive`).",
        "",
    )
    yield from (".. list-table::", "   :header-rows: 1", "", "   * - name", "     - formula")
    for name, pseudo in gb.PSEUDO_INPUTS.items():
        yield from (f"   * - ``{name}``", f"     - ``{pseudo.formula}``")


def reports_page() -> Iterator[str]:
    """Yield the page that leads to the reports."""
    yield from title("Reports")
    yield from ("Reports from the last run of each script in ``experiments/``.", "")
    yield from (".. toctree::", "   :maxdepth: 1", "", *(f"   {name}" for name in REPORTS.values()))


def report_page(source: str) -> Iterator[str]:
    """Yield a page that is a file from elsewhere in the repository."""
    links = "docs/" if source in OF_PROJECT else "."  # how those begin that are relative to the file
    yield from (f"```{{include}} ../../../{source}", ":relative-images:", f":relative-docs: {links}", "```")


def relink(_: Any, page: str, source: list[str]) -> None:
    """Let links to those files lead to their pages, and those that show a file's name show words: my_log.md, my log."""
    up = "../" * page.count("/")
    for path, name in (REPORTS | OF_PROJECT).items():
        source[0] = source[0].replace(f"]({up}../{path}", f"]({up}reference/generated/{name}.md")
    source[0] = re.sub(r"\[([a-z_]+)\.md\]\(", lambda found: f"[{found[1].replace('_', ' ')}](", source[0])


def write() -> None:
    """Write the pages; one that says the same stays as it is, so that a second build is quick."""
    HERE.mkdir(parents=True, exist_ok=True)
    pages = {"names.rst": names_page(), "theory.rst": theory_page(), "channels.rst": channels_page()}
    pages |= {"reports.rst": reports_page()} | {
        f"{name}.md": report_page(path) for path, name in (REPORTS | OF_PROJECT).items()
    }
    for name, page in pages.items():
        path, text = HERE / name, "\n".join(page).rstrip() + "\n"
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def setup(app: Any) -> dict[str, bool]:
    """Write them, before Sphinx looks for pages."""
    write()
    app.connect("source-read", relink)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
