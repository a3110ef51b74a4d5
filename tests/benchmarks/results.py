"""Where the figures go: ``bench.json`` and a page's block, each written aside and moved into place."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from gtmbench.files.writing import atomic_write

from .table import block

ROOT = Path(__file__).parents[2]
BENCH, PAGE = ROOT / "bench.json", ROOT / "docs/reference/measured.md"
BEGIN, END = "<!-- make bench writes this -->\n", "<!-- up to here -->"


def rounded(value: Any) -> Any:
    """Round every float to three digits, so that a rerun reviews well."""
    if isinstance(value, float):
        return float(f"{value:.3g}")
    if isinstance(value, dict):
        return {key: rounded(item) for key, item in value.items()}
    return [rounded(item) for item in value] if isinstance(value, list) else value


def block_of_the_page() -> str:
    """Return what stands between the page's two marks."""
    return PAGE.read_text().split(BEGIN)[1].split(END)[0].rstrip()


def write(results: dict) -> None:
    """Write both files; `results` are rounded."""
    before, rest = PAGE.read_text().split(BEGIN)
    texts = {
        BENCH: json.dumps(results, indent=2, sort_keys=True, allow_nan=False) + "\n",
        PAGE: before + BEGIN + block(results) + "\n" + END + rest.split(END, 1)[1],
    }
    for path, text in texts.items():
        with atomic_write(path) as aside:
            aside.write_text(text)
