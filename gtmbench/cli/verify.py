"""``gtmbench verify``: whether files still hold what was written, and recordings what another holds."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gtmbench.checks import number
from gtmbench.cli.options import refuse
from gtmbench.cli.output import (
    PATH,
    HeadedCommand,
    claim_file,
    common_options,
    echo,
    finish,
    is_json,
    print_table,
    say,
    shown_progress,
)
from gtmbench.errors import GtmbenchError, InputError, NoteWarning
from gtmbench.files.folders import SUMS, read_sums, settle
from gtmbench.files.plain import envelope
from gtmbench.files.seals import file_digest
from gtmbench.files.writing import is_file, is_folder
from gtmbench.report.words.units import counted

if TYPE_CHECKING:
    from gtmbench.report.recording.diff import RecordingDiff

_ALTERED = 1


_Told = tuple[Path, str]  # a file, and what is wrong with it; empty where it holds what was written


@click.command("verify", cls=HeadedCommand)
@click.argument("paths", nargs=-1, required=True, metavar="FOLDER|FILE...", type=PATH)
@click.option("--against", type=PATH, metavar="B.rrd", help="Compare a recording with this one: values, not bytes.")
@click.option(
    "--tolerance",
    default=0.0,
    metavar="REL",
    help="With --against: relative tolerance, in parts of a series' greatest magnitude.",
)
@click.option(
    "--absolute", default=0.0, metavar="ABS", help="With --against: absolute tolerance, in a series' own unit."
)
@click.option("--overlay", type=PATH, metavar="OUT.rrd", help="With --against: write both into one recording.")
@click.option("--force", is_flag=True, help="Write over an existing overlay.")
@common_options
def verify_command(
    paths: tuple[Path, ...], against: Path | None, tolerance: float, absolute: float, overlay: Path | None, force: bool
) -> int:
    """Check that results are what they were: files against their digests, or a recording against another.

    Example: gtmbench verify first

    In a folder it checks every file in its SHA256SUMS, every part and every monitor; of single files monitors,
    baselines, and what a SHA256SUMS beside them lists. Recordings of `gtmbench run` are compared by --against: without
    a tolerance numbers must be equal bit for bit, as they are for two runs of one seed. Texts always must.

    Exit codes: 0 all are unchanged, or equal; 1 a file was altered, damaged or is missing, or they differ; 2 a file
    can't be checked.
    """
    if against is not None:
        if len(paths) > 1:
            raise InputError(f"--against compares one recording, and {len(paths)} are given")
        return _compare(paths[0], against, tolerance, absolute, overlay, force=force)
    of_two = {"--tolerance": tolerance, "--absolute": absolute, "--overlay": overlay}
    refuse(of_two, "of --against, which is missing")
    told = [each for path in paths for each in _integrity_of(path)]
    wrong = [(path, why) for path, why in told if why]
    code = _ALTERED if wrong else 0
    findings = [{"text": f"{path}: {why}", "file": str(path), "wrong": why} for path, why in wrong]
    finish(envelope("verify", _verdict(told, wrong), {"files": len(told)}, exit_code=code, findings=findings))
    if not is_json():
        say(row["text"] for row in findings)
    return code


def _verdict(told: Sequence[_Told], wrong: Sequence[_Told]) -> str:
    if wrong:
        verb = "isn't" if len(wrong) == 1 else "aren't"
        return f"{len(wrong)} of {counted(len(told), 'file')} {verb} what was written."
    return f"{counted(len(told), 'file')} {'holds' if len(told) == 1 else 'hold'} what was written."


def _integrity_of(path: Path) -> Iterator[_Told]:
    if is_folder(path):
        yield from _folder(path)
    elif not is_file(path):
        raise InputError(f"{path}: no such file or folder")
    elif path.suffix == ".json" and _is_monitor(path):
        yield _monitor(path)
    elif path.suffix == ".toml":
        yield _baseline(path)
    else:
        sums = path.parent / SUMS
        if not is_file(sums) or path.name not in (known := read_sums(sums)):
            raise InputError(f"{path}: nothing says what it held: it is no monitor and no baseline, and in no {SUMS}")
        yield _summed(path.parent, path.name, known[path.name])


def _folder(folder: Path) -> Iterator[_Told]:
    from gtmbench.jobs.parts import holds_parts, read_parts

    try:
        settle(folder)
    except GtmbenchError as error:
        yield (folder, str(error))
    monitors = [path for path in sorted(folder.glob("*.json")) if _is_monitor(path)]
    if not is_file(folder / SUMS) and not holds_parts(folder) and not monitors:
        raise InputError(f"{folder} holds neither {SUMS}, nor parts, nor monitors, so nothing says what it held")
    if is_file(folder / SUMS):
        for name, digest in read_sums(folder / SUMS).items():
            yield _summed(folder, name, digest)
    if holds_parts(folder):
        parts = read_parts(folder)
        damaged = parts.damaged()
        yield from ((parts.path(number), damaged[number]) for number in damaged)
        whole = {*folder.glob("part-*.parquet")} - {*map(parts.path, damaged)}
        yield from ((path, "") for path in sorted(whole))
    yield from map(_monitor, monitors)


def _summed(folder: Path, name: str, digest: str) -> _Told:
    path = folder / name
    if not path.resolve().is_relative_to(folder.resolve()):
        return (path, f"{SUMS} names a file outside of its folder, which isn't read")
    if path.exists() and not path.is_file():
        return (path, "it isn't a file any more")
    try:
        is_same = file_digest(path) == digest
    except OSError as error:
        return (path, error.strerror or str(error))
    return (path, "" if is_same else f"it isn't what was written, by {SUMS}: altered or damaged")


def _is_monitor(path: Path) -> bool:
    if not is_file(path):
        return False
    with path.open("rb") as file:
        return b'"gtmbench monitor"' in file.read(200)


def _monitor(path: Path) -> _Told:
    from gtmbench.detectors.monitor_file import check_monitor

    try:
        check_monitor(path)
    except InputError as error:
        return (path, str(error).removeprefix(f"{path}: "))
    return (path, "")


def _baseline(path: Path) -> _Told:
    from gtmbench.check.baseline import read_reference

    reference = read_reference(path)
    if reference.note and not reference.altered:
        warnings.warn(NoteWarning(f"{path} {reference.note}"), stacklevel=2)
    return (path, "its figures aren't those that were recorded, by its digest" if reference.altered else "")


_MOST = 20  # rows of a table; --json lists all


def _compare(a: Path, b: Path, tolerance: float, absolute: float, overlay: Path | None, *, force: bool) -> int:
    """Compare two recordings, print how they differ, and return the exit code."""
    from gtmbench.report.recording.diff import Closeness, compare
    from gtmbench.report.recording.overlay import write_overlay
    from gtmbench.report.recording.read import read_recording, recording_in

    a, b = recording_in(a), recording_in(b)
    relative, absolute = number("--tolerance", tolerance, 0.0), number("--absolute", absolute, 0.0)
    claim_file(overlay, force=force, option="--overlay", ends=[".rrd"], read=[a, b])
    with shown_progress() as tell:
        total = 3 + (overlay is not None)
        tell(f"reading {a.name}", 0, total)
        frame_a = read_recording(a)
        tell(f"reading {b.name}", 1, total)
        frame_b = read_recording(b)
        tell("comparing", 2, total)
        comparison = compare(frame_a, frame_b, Closeness(relative=relative, absolute=absolute))
        if overlay is not None:
            tell("overlay", 3, total)
            write_overlay(frame_a, frame_b, comparison, overlay, names=(str(a), str(b)))

    def rest() -> None:
        _print_comparison(comparison, a, b)
        if overlay is not None:
            echo(f"laid over each other: {overlay}    look at it: gtmbench view {overlay}")

    return finish(_comparison_table(comparison, a, b, overlay), rest)


def _comparison_table(comparison: RecordingDiff, a: Path, b: Path, overlay: Path | None) -> dict[str, Any]:
    from gtmbench.report.recording.diff import field_rows

    own = {"a": a, "b": b, "overlay": overlay, "equal": comparison.equal, **asdict(comparison)}
    found = [
        *({"text": f"{line.text}: samples that differ: {line.differing_text}"} for line in comparison.lines),
        *({"text": f"{entity} {field}: {a}, {b}"} for entity, field, a, b in field_rows(comparison)),
        *({"text": f"only in {event['only_in']}: {event['text']}"} for event in comparison.told),
        *({"text": f"only in {which}: {' '.join(name)}"} for which, name in comparison.alone),
    ]
    return envelope("verify-against", comparison.text, own, exit_code=int(not comparison.equal), findings=found)


def _print_comparison(comparison: RecordingDiff, a: Path, b: Path) -> None:
    from gtmbench.report.recording.diff import difference_tables

    echo(f"A: {a}\nB: {b}")
    if said := _other_flight(comparison):
        echo(said, bold=True)
    for title, columns, rows in difference_tables(comparison):
        print_table(title, columns, rows[:_MOST], right=columns[1:] if columns[0] == "series" else [])
        if len(rows) > _MOST:
            echo(f"... and {len(rows) - _MOST} more; --json lists all\n")


def _other_flight(comparison: RecordingDiff) -> str:
    """Say where the recordings aren't of one flight, or not of one draw of noise: then nearly every sample differs."""
    flown = [line.name for line in comparison.lines if 2 * line.differing > line.samples]
    if any(entity.startswith("/truth") for entity, _ in flown):
        return "these are different flights: what was flown differs (another seed, excitation or aircraft)"
    if any(entity.startswith("/sensors") for entity, _ in flown):
        return "these are different records: what sensors read differs throughout (another seed of the noise)"
    return ""
