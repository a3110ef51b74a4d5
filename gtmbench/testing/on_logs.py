"""What the assertions do with recorded flights: watch them as ``gtmbench monitor`` does, and hold the verdict."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from gtmbench.checks import number
from gtmbench.errors import InputError
from gtmbench.files.artefacts import artefacts
from gtmbench.intake.contents import log_columns
from gtmbench.intake.flight_log import FlightLog
from gtmbench.intake.formats.registry import is_log
from gtmbench.report.words.verdict import verdict_text
from gtmbench.verdict.timeline import SensorSpan, State
from gtmbench.verdict.verdict import Outcome

if TYPE_CHECKING:
    from gtmbench.log.watched_log import WatchedLog


def watched_log(log: object, detector: Any = "auto", *, mapping: Sequence[str] = (), **how: Any) -> WatchedLog:
    """Return a log watched, an opened one as it was read; how else is as `watch_log` takes it."""
    from gtmbench.log.watch import watch_log

    if isinstance(log, FlightLog):
        return watch_log(log.path, detector, mapping=mapping or _mapping_of(log), **how)
    return watch_log(str(log), detector, mapping=mapping, **how)


def is_flight(given: object) -> bool:
    """Whether a recorded flight was given: an opened log, or the path of a file that is one."""
    if isinstance(given, FlightLog):
        return True
    return isinstance(given, (str, Path)) and Path(given).is_file() and is_log(Path(given))


def hold_quiet(watched: WatchedLog) -> None:
    """Fail unless nothing is found in a log, and enough of it is judged."""
    __tracebackhide__ = True
    if watched.verdict.outcome is not Outcome.HEALTHY:
        _fail(watched, f"{watched.log.path.name}: {verdict_text(watched)} (allowed: nothing found)")


def hold_found(watched: WatchedLog, *, sensor: str, from_s: float, within_s: float) -> None:
    """Fail unless a sensor failed from a time on, and no other did."""
    __tracebackhide__ = True
    from_s, within_s = number("from_s", from_s), number("within_s", within_s, 0.0)
    timeline = watched.verdict.timeline
    if sensor not in timeline.sensors:
        raise InputError(f"{watched.log.path}: nothing judges '{sensor}'; there are {', '.join(timeline.sensors)}")
    failed = timeline.of(sensor, State.FAILED)
    complaints = [] if any(abs(span.start_s - from_s) <= within_s for span in failed) else [_missed(failed)]
    others = [name for name, _ in watched.verdict.failed if name != sensor]
    if others:
        complaints.append(f"{', '.join(dict.fromkeys(others))} failed, too")
    if complaints:
        allowed = f"{sensor} failed from {from_s:g} s on, give or take {within_s:g} s, and nothing else"
        said = f"{'; '.join(complaints)} (allowed: {allowed})"
        _fail(watched, f"{watched.log.path.name}: {said}. {verdict_text(watched)}")


def _missed(failed: Sequence[SensorSpan]) -> str:
    if not failed:
        return "no failure was found"
    return f"the failure begins at {', '.join(f'{span.start_s:.2f} s' for span in failed)}"


def _mapping_of(log: FlightLog) -> tuple[str, ...]:
    """Return how an opened log's columns were read, as ``--map`` says it; computed ones are computed again."""
    columns = {column.name for column in log_columns(log.path)}
    return tuple(f"{source.channel}={source.typed}" for source in log.sources if source.column in columns)


def _fail(watched: WatchedLog, said: str) -> NoReturn:
    __tracebackhide__ = True

    def write(path: Path) -> None:
        from gtmbench.report.recording.write import write_log_recording

        write_log_recording(watched, path)

    raise AssertionError(f"{said} {artefacts().record(write)}")
