"""``gtmbench export``: a calibrated monitor as C."""

from __future__ import annotations

from pathlib import Path

import click

from gtmbench.cli.command import PATH, HeadedCommand, common_options
from gtmbench.cli.output import claim_folder, finish
from gtmbench.report.tables.envelope import envelope


@click.command("export", cls=HeadedCommand)
@click.argument("monitor", metavar="MONITOR.json", type=PATH)
@click.option("--out", default="on_board", show_default=True, type=PATH, help="The folder of C code.")
@click.option(
    "--full/--compact",
    "full",
    default=True,
    help="Keep every sample of the minute before a window, or means of a few: half of the memory, and alarms may come "
    "a few samples sooner or later.  [default: full]",
)
@click.option("--force", is_flag=True, help="Write over files of the same names.")
@common_options
def export_command(monitor: Path, out: Path, full: bool, force: bool) -> None:
    """Write a calibrated bank as C99 for a flight controller: code, its own test and a README.

    Example: gtmbench export monitor.json --out on_board

    It detects faults with the noise that it learns in flight, says which sensors could be at fault by structure, and
    predicts each watched sensor. Which kind of fault it is, and how large, `gtmbench monitor` says on the flight's log.
    """
    from gtmbench.export.write import FILES, export_c

    claim_folder(out, force=force)
    exported = export_c(monitor, out, compact=not full, force=force)
    board = exported.board
    residuals = ", ".join(each.output for each in board.residuals)
    verdict = f"Wrote bank {board.name} with residuals of {residuals} as C, {exported.variant}: {out}."
    own = {
        "out": str(out),
        "files": FILES,
        "variant": exported.variant,
        "digest": exported.digest,
        "channels": board.channels,
        "residuals": [each.output for each in board.residuals],
        "sample_period_s": board.period_s,
    }
    test = f"test it: cmake -S {out} -B {out}/build && cmake --build {out}/build && ctest --test-dir {out}/build"
    finish(envelope("export", verdict, own), lambda: [test])
