"""What stands in pages: their blocks, and their commands, run in one folder, each with what those before it wrote."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from gtmbench.cli.app import main

ROOT = Path(__file__).parents[2]


def blocks(page, language):
    """Return the contents of a page's blocks of a language; a list's are indented."""
    found = re.findall(rf"^( *)```{language}\n(.*?)^ *```", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    return ["".join(line.removeprefix(indent) for line in text.splitlines(keepends=True)) for indent, text in found]


def commands(page):
    """Return a page's command lines, without what is said of them."""
    lines = [line.split(" #")[0].strip() for block in blocks(page, "sh") for line in block.splitlines()]
    return [line for line in lines if line]


def run_chain(lines, folder, monkeypatch, capsys, *, cheap=None, codes=None):
    """Run command lines and return what they printed; `view` opens a window, so it has only to get there.

    What listens to a link does so in a process of its own, until it ends by itself.

    `cheap` has what is added to those that begin so, `codes` with which code one ends that doesn't end with 0.
    """
    monkeypatch.chdir(folder)
    monkeypatch.setattr("gtmbench.study.watchers.FLIGHTS", 2)
    monkeypatch.setattr("os.cpu_count", lambda: 1)  # flights are flown in turn
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    listening: list[subprocess.Popen[str]] = []
    printed = []
    for line in lines:
        more = (cheap or {}).get(
            max((known for known in cheap or {} if line.startswith(known)), key=len, default=""), ""
        )
        if line.startswith("gtmbench live udp:"):  # in another terminal, until the one after it has sent a flight
            listening.append(_listening(f"{line} {more}"))
            continue
        with pytest.raises(SystemExit) as ended:
            main(shlex.split(f"{line} {more}")[1:])
        out, err = capsys.readouterr()
        if " view " in line and sys.platform == "linux":
            assert "there is no screen here" in err
        else:
            assert (ended.value.code, err) == ((codes or {}).get(line, 0), ""), line
            assert out
            printed.append(out)
    for process in listening:
        said, _ = process.communicate(timeout=120)
        assert "watching" in said, said
        assert process.returncode in (0, 1, 3), said
    return "".join(printed)


def _listening(line):
    """Start what listens to a link, and wait until it does."""
    process = subprocess.Popen(
        [sys.executable, "-m", *shlex.split(line)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stderr is not None
    assert "listening" in process.stderr.readline()
    return process
