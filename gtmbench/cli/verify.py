"""``gtmbench verify``: whether files still hold what was written, and recordings what another holds."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import click

from gtmbench.cli.command import HeadedCommand
from gtmbench.cli.diff import Limits, compare_recordings
from gtmbench.cli.output import common_options, echo, print_json
from gtmbench.errors import GtmbenchError, InputError, NoteWarning
from gtmbench.files.disk import is_file, is_folder
from gtmbench.files.folders import SUMS, read_sums, settle
from gtmbench.files.seals import file_digest
from gtmbench.report.tables.envelope import envelope
from gtmbench.report.words.units import counted

_ALTERED = 1


class _Told(NamedTuple):
    """A file, and what is wrong with it; empty where it holds what was written."""

    path: Path
    wrong: str


@click.command("verify", cls=HeadedCommand)
@click.argument("paths", nargs=-1, required=True, metavar="FOLDER|FILE...", type=click.Path(path_type=Path))
@click.option(
    "--against",
    type=click.Path(path_type=Path),
    metavar="B.rrd",
    help="Compare a recording with this one: values, not bytes.",
)
@click.option(
    "--tolerance",
    default=0.0,
    metavar="REL",
    help="With --against: relative tolerance, in parts of a series' greatest magnitude.",
)
@click.option(
    "--absolute", default=0.0, metavar="ABS", help="With --against: absolute tolerance, in a series' own unit."
)
@click.option(
    "--overlay",
    type=click.Path(path_type=Path),
    metavar="OUT.rrd",
    help="With --against: write both into one recording.",
)
@click.option("--force", is_flag=True, help="Write over an existing overlay.")
@common_options
def verify_command(
    paths: tuple[Path, ...],
    against: Path | None,
    tolerance: float,
    absolute: float,
    overlay: Path | None,
    force: bool,
    as_json: bool,
    quiet: bool,
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
        limits = Limits(relative=tolerance, absolute=absolute)
        return compare_recordings(paths[0], against, limits, overlay, force=force, as_json=as_json, quiet=quiet)
    if tolerance or absolute or overlay is not None:
        raise InputError("--tolerance, --absolute and --overlay are of --against, which is missing")
    told = [each for path in paths for each in _integrity_of(path)]
    wrong = [each for each in told if each.wrong]
    code = _ALTERED if wrong else 0
    findings = [{"text": f"{each.path}: {each.wrong}", "file": str(each.path), "wrong": each.wrong} for each in wrong]
    if as_json:
        print_json(envelope("verify", _verdict(told, wrong), {"files": len(told)}, exit_code=code, findings=findings))
    else:
        for line in [_verdict(told, wrong)] * (not quiet) + [row["text"] for row in findings]:
            echo(line)
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
        yield _Told(folder, str(error))
    monitors = [path for path in sorted(folder.glob("*.json")) if _is_monitor(path)]
    if not is_file(folder / SUMS) and not holds_parts(folder) and not monitors:
        raise InputError(f"{folder} holds neither {SUMS}, nor parts, nor monitors, so nothing says what it held")
    if is_file(folder / SUMS):
        for name, digest in read_sums(folder / SUMS).items():
            yield _summed(folder, name, digest)
    if holds_parts(folder):
        parts = read_parts(folder)
        damaged = parts.damaged()
        yield from (_Told(parts.path(number), damaged[number]) for number in damaged)
        whole = {*folder.glob("part-*.parquet")} - {*map(parts.path, damaged)}
        yield from (_Told(path, "") for path in sorted(whole))
    yield from map(_monitor, monitors)


def _summed(folder: Path, name: str, digest: str) -> _Told:
    path = folder / name
    if not path.resolve().is_relative_to(folder.resolve()):
        return _Told(path, f"{SUMS} names a file outside of its folder, which isn't read")
    if path.exists() and not path.is_file():
        return _Told(path, "it isn't a file any more")
    try:
        is_same = file_digest(path) == digest
    except OSError as error:
        return _Told(path, error.strerror or str(error))
    return _Told(path, "" if is_same else f"it isn't what was written, by {SUMS}: altered or damaged")


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
        return _Told(path, str(error).removeprefix(f"{path}: "))
    return _Told(path, "")


def _baseline(path: Path) -> _Told:
    from gtmbench.check.baseline import read_reference

    reference = read_reference(path)
    if reference.note and not reference.altered:
        warnings.warn(NoteWarning(f"{path} {reference.note}"), stacklevel=2)
    return _Told(path, "its figures aren't those that were recorded, by its digest" if reference.altered else "")
