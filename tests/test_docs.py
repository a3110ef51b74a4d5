"""The pages under docs/ tell the truth: their Python runs, their commands are commands, their example is the file."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from gtmbench.cli.app import app

ROOT = Path(__file__).parent.parent
PAGES = sorted((ROOT / "docs").glob("*.md"))


def blocks(page, language):
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(), flags=re.DOTALL)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_its_python_runs(page, tmp_path):
    """In a process of its own, for it registers a fault."""
    script = "\n".join(blocks(page, "python"))
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (run.returncode, run.stderr) == (0, "")
    if page.stem == "detectors":
        assert re.search(r"^0 \d+\.\d+ q alarm$", run.stdout, flags=re.MULTILINE)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_its_commands_parse(page):
    for line in "".join(blocks(page, "sh")).splitlines():
        program, command, *arguments = shlex.split(line, comments=True)
        assert program == "gtmbench"
        app.commands[command].make_context(command, arguments)


def test_the_example_is_the_file_and_short():
    example = (ROOT / "docs/examples/limit_check.py").read_text()
    assert example == blocks(ROOT / "docs/detectors.md", "python")[0]
    assert len(example.splitlines()) <= 25


def test_links_lead_somewhere():
    for page in (*PAGES, ROOT / "README.md"):
        for target in re.findall(r"\]\(([^)#]+\.md)(?:#[^)]*)?\)", page.read_text()):
            assert (page.parent / target).is_file(), target


def test_files_that_are_named_exist():
    """Whole paths anywhere; in the table of rooms, what to begin with stands below its room."""
    for page in PAGES:
        text = page.read_text()
        named = set(re.findall(r"`((?:gtmbench|aircraft|docs|experiments|faults|tests)/[\w./-]+)`", text)) - {
            "aircraft/NAME/"
        }
        for room, first in re.findall(r"^\| `(gtmbench/\w+/)`[^|]*\|[^|]*\| (`[^|]*`) \|$", text, flags=re.MULTILINE):
            named |= {room + name for name in re.findall(r"`([\w./]+)`", first)}
        assert [name for name in named if not (ROOT / name).exists()] == []
    assert len(named) > 0


def test_every_room_stands_in_the_design():
    text = (ROOT / "docs/design.md").read_text()
    rooms = [path.parent for path in (ROOT / "gtmbench").glob("*/__init__.py")]
    assert len(rooms) > 9
    for room in rooms:
        assert re.search(rf"^\| `gtmbench/{room.name}/`", text, flags=re.MULTILINE), room.name
        inner = [path.parent.name for path in room.glob("*/__init__.py")]
        line = re.search(rf"^\| `gtmbench/{room.name}/`.*$", text, flags=re.MULTILINE)[0]
        assert [name for name in inner if f"{name}/`" not in line] == []
