"""``gtmbench verify --against``: two recordings, compared."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from gtmbench.checks import number
from gtmbench.cli.output import claim_file, echo, print_json, print_table
from gtmbench.errors import InputError
from gtmbench.jobs.progress import progress_bar
from gtmbench.report.tables.envelope import envelope

if TYPE_CHECKING:
    from gtmbench.report.recording.diff import LineDifference, RecordingDiff


_MOST = 20  # rows of a table; --json lists all


class Limits(NamedTuple):
    """How far values may differ, as they were typed."""

    relative: float
    absolute: float


def compare_recordings(
    a: Path, b: Path, limits: Limits, overlay: Path | None, *, force: bool, as_json: bool, quiet: bool
) -> int:
    """Compare two recordings, print how they differ, and return the exit code."""
    from gtmbench.report.recording.diff import Closeness, compare
    from gtmbench.report.recording.read import read_recording, recording_in

    a, b = recording_in(a), recording_in(b)
    relative, absolute = number("--tolerance", limits.relative, 0.0), number("--absolute", limits.absolute, 0.0)
    if overlay is not None:
        _check_overlay(overlay, a, b, force=force)
    with progress_bar(silent=as_json or quiet) as tell:
        total = 3 + (overlay is not None)
        tell(f"reading {a.name}", 0, total)
        frame_a = read_recording(a)
        tell(f"reading {b.name}", 1, total)
        frame_b = read_recording(b)
        tell("comparing", 2, total)
        comparison = compare(frame_a, frame_b, Closeness(relative=relative, absolute=absolute))
        if overlay is not None:
            from gtmbench.report.recording.overlay import write_overlay

            tell("overlay", 3, total)
            write_overlay(frame_a, frame_b, comparison, overlay, names=(str(a), str(b)))
    if as_json:
        _print_json(comparison, a, b, overlay)
    elif not quiet:
        _print(comparison, a, b)
        if overlay is not None:
            echo(f"laid over each other: {overlay}    look at it: gtmbench view {overlay}")
    return 0 if comparison.equal else 1


def _check_overlay(overlay: Path, a: Path, b: Path, *, force: bool) -> None:
    if overlay.suffix != ".rrd":
        raise InputError(f"--overlay is '{overlay}'; a recording ends in .rrd")
    if overlay.exists() and any(given.exists() and overlay.samefile(given) for given in (a, b)):
        raise InputError(f"--overlay is {overlay}, one of the two recordings; give another name")
    claim_file(overlay, force=force, option="--overlay")


def _print_json(comparison: RecordingDiff, a: Path, b: Path, overlay: Path | None) -> None:
    overlaid = None if overlay is None else str(overlay)
    own = {"a": str(a), "b": str(b), "overlay": overlaid, "equal": comparison.equal, **asdict(comparison)}
    found = [
        *({"text": f"{_name(line)}: samples that differ: {_differing(line)}"} for line in comparison.lines),
        *({"text": f"{one.entity} {one.field}: {_cell(one.a)}, {_cell(one.b)}"} for one in comparison.verdicts),
        *({"text": f"only in {event.only_in}: {event.text}"} for event in comparison.told),
        *({"text": f"only in {which}: {' '.join(name)}"} for which, name in _alone(comparison)),
    ]
    print_json(
        envelope("verify-against", _summary(comparison), own, exit_code=int(not comparison.equal), findings=found)
    )


def _alone(comparison: RecordingDiff) -> list[tuple[str, tuple[str, str]]]:
    """Return series and fields that only one recording has."""
    return [("A", name) for name in comparison.only_a] + [("B", name) for name in comparison.only_b]


def _print(comparison: RecordingDiff, a: Path, b: Path) -> None:
    echo(_summary(comparison))
    echo(f"A: {a}\nB: {b}")
    if said := _other_flight(comparison):
        echo(said, bold=True)
    if comparison.lines:
        names = ["samples that differ", "at worst", "A", "B", "difference", "relative"]
        rows = [_row(line) for line in comparison.lines]
        _table("Series that differ, the worst first", ["series", *names], rows, right=names)
    if comparison.verdicts:
        rows = [[field.entity, field.field, _cell(field.a), _cell(field.b)] for field in comparison.verdicts]
        _table("Verdicts that differ", ["verdict", "field", "A", "B"], rows)
    if comparison.told:
        rows = [[event.only_in, event.entity, event.level, event.text] for event in comparison.told]
        _table("Events in one only", ["in", "entity", "level", "event"], rows)
    if alone := _alone(comparison):
        _table("Series and fields in one only", ["in", "entity", "series"], [[which, *name] for which, name in alone])


def _other_flight(comparison: RecordingDiff) -> str:
    """Say where the recordings aren't of one flight, or not of one draw of noise: then nearly every sample differs."""
    flown = [line.name for line in comparison.lines if 2 * line.differing > line.samples]
    if any(entity.startswith("/truth") for entity, _ in flown):
        return "these are different flights: what was flown differs (another seed, excitation or aircraft)"
    if any(entity.startswith("/sensors") for entity, _ in flown):
        return "these are different records: what sensors read differs throughout (another seed of the noise)"
    return ""


def _table(title: str, columns: list[str], rows: list[list[str]], right: list[str] | None = None) -> None:
    print_table(title, columns, rows[:_MOST], right=right or [])
    if len(rows) > _MOST:
        echo(f"... and {len(rows) - _MOST} more; --json lists all\n")


def _name(line: LineDifference) -> str:
    return line.entity if line.entity.endswith(f"/{line.series}") else f"{line.entity} {line.series}"


def _differing(line: LineDifference) -> str:
    of, others = f"{line.differing} of {line.samples}", line.only_a + line.only_b
    return f"{of}, {others} at other times" if others else of


def _row(line: LineDifference) -> list[str]:
    name, counted, worst = _name(line), _differing(line), line.worst
    if worst is None:
        return [name, counted, *[""] * 5]
    at = worst.at if isinstance(worst.at, str) else f"{worst.at:.10g} s"
    values = [f"{value:.6g}" for value in (worst.a, worst.b, worst.difference)]
    return [name, counted, at, *values, "" if line.only_a + line.only_b else f"{line.relative:.1e}"]


def _cell(value: float | str | None) -> str:
    return value if isinstance(value, str) else "-" if value is None else f"{value:.10g}"


def _summary(comparison: RecordingDiff) -> str:
    alone = len(_alone(comparison))
    held = f"{comparison.series} series, {comparison.fields} fields of verdicts, {comparison.events} events"
    if comparison.equal:
        return f"Equal: {held}."
    only = f"; {alone} series or fields in one only" if alone else ""
    series = f"{len(comparison.lines)} of {comparison.series} series"
    fields = f"{len(comparison.verdicts)} of {comparison.fields} fields of verdicts"
    return f"Different: {series}, {fields}, {len(comparison.told)} events in one only{only}."
