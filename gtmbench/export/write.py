"""The folder of C: written whole or not at all, the same bytes for the same monitor."""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from gtmbench.detectors.monitor_file import load_monitor
from gtmbench.detectors.protocol import Monitor
from gtmbench.export.board import Board, board_of
from gtmbench.export.source import fields_of, sizes_of, tables_of
from gtmbench.files.folders import atomic_folder, check_folder
from gtmbench.version import __version__


def render(board: Board, digest: str, *, compact: bool) -> dict[str, str]:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(  # noqa: S701 - C, not HTML: nothing of a monitor's texts gets in but what board checks
        loader=PackageLoader("gtmbench.export", "c"), undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    tables, checksum = tables_of(board)
    said = dict(
        title="A monitor of aircraft sensors",
        version=__version__, digest=digest, variant="compact" if compact else "full", compact=compact,
        sizes=sizes_of(board, compact=compact),
        residual_bits=[(each.output.upper(), 1 << j) for j, each in enumerate(board.residuals)],
        sensor_bits=[(name.upper(), 1 << j) for j, name in enumerate(board.sensors)],
        fields=fields_of(board),
        lost_type="uint8_t" if len(board.channels) <= 8 else "uint16_t",
        tables=tables, period_s=f"{board.period_s:.9g}f", checksum=checksum,
    )
    return {name: environment.get_template(f"{name}.jinja").render(said) for name in ("gtm_monitor.h", "gtm_monitor.c")}
