"""An airframe's history on the command line: flights judged one after the other, each beside those before it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gtmbench.cli.output import is_json, is_silent, print_json, say, screen_width, shown_progress
from gtmbench.errors import GtmbenchError, InputError
from gtmbench.files.writing import atomic_write, is_folder
from gtmbench.jobs.progress import Progress, limited, silent

if TYPE_CHECKING:
    from gtmbench.history.entry import Entry
    from gtmbench.log.watched_log import WatchedLog

_ORDER = ("failed", "unknown", "healthy", "error")  # whose exit code counts, the first of these
_CODES = {"failed": 1, "unknown": 3, "healthy": 0, "error": 2}  # exit codes
Told = Callable[[int, int], None]


@dataclass(frozen=True, kw_only=True)
class Keeping:
    """How flights are judged and entered: whose history it is, what `watch_log` takes beside the log, for how long."""

    history: Path
    aircraft_id: str
    how: Mapping[str, Any]
    limit_s: float | None

    def enter(self, logs: Sequence[Path], tell: Told = lambda _number, _count: None) -> list[dict[str, Any]]:
        """Judge and enter flights one after the other; return a row each. One that can't be read stops no other."""
        rows = []
        for number, log in enumerate(logs):
            tell(number, len(logs))
            rows.append({"log": log.name, **self._entered(log)})
        return rows

    def watched(self, log: Path, progress: Progress = silent) -> WatchedLog:
        """Return a log as it is judged beside the history."""
        from gtmbench.log.watch import watch_log

        return watch_log(log, **self.how, history=self.history, aircraft_id=self.aircraft_id, progress=progress)

    def add(self, watched: WatchedLog) -> bool:
        """Enter a log that was judged; return whether it is new."""
        from gtmbench.log.history import entered

        return entered(watched, self.history)

    def left(self, logs: Sequence[Path]) -> list[Path]:
        """Return the logs of a history that is a folder which aren't entered yet, and aren't judged themselves."""
        from gtmbench.log.fleet import logs_in
        from gtmbench.log.history import digest_of

        if not is_folder(self.history):
            return []
        known, own = {entry.digest for entry in self._entries()}, {path.resolve() for path in logs}
        found = [path for path in logs_in([self.history]) if path.resolve() not in own]
        return [path for path in found if digest_of(path) not in known]

    def airframes(self) -> dict[str, list[Entry]]:
        """Return the flights of each airframe, or of the one that is named."""
        found: dict[str, list[Entry]] = {}
        for entry in self._entries():
            found.setdefault(entry.airframe, []).append(entry)
        of_one = {name: own for name, own in found.items() if self.aircraft_id in ("", name)}
        if not of_one:
            of = f" of '{self.aircraft_id}'; it has {', '.join(found)}" if found else ""
            raise InputError(f"{self.history} holds no flight{of}; enter some: gtmbench monitor LOG --history FILE")
        return of_one

    def _entries(self) -> tuple[Entry, ...]:
        from gtmbench.history.entry import history_file, read_history

        return read_history(history_file(self.history))

    def _entered(self, log: Path) -> dict[str, Any]:
        from gtmbench.report.words.verdict import verdict_text

        try:
            with limited(self.limit_s):
                watched = self.watched(log)
        except GtmbenchError as error:
            return {"outcome": "error", "verdict": str(error), "entered": False}
        is_new = self.add(watched)
        return {"outcome": watched.outcome.name.lower(), "verdict": verdict_text(watched), "entered": is_new}


def keeping_of(
    history: Path | None, aircraft_id: str | None, how: Mapping[str, Any], limit_s: float | None
) -> Keeping | None:
    """Return how flights are kept; None where no history is given."""
    if history is None:
        if aircraft_id is not None:
            raise InputError("--aircraft-id is of a history; give --history, too")
        return None
    return Keeping(history=history, aircraft_id=aircraft_id or "", how=how, limit_s=limit_s)


def monitor_history(keeping: Keeping, sources: Sequence[Path], *, record: Path | None, reports: Sequence[Path]) -> int:
    """Judge and enter what isn't yet, write the airframe's page, and return the exit code."""
    from gtmbench.log.fleet import logs_in
    from gtmbench.report.airframe import airframe_results

    if not sources and not is_folder(keeping.history):
        keeping.airframes()  # or there is none
    before = keeping.left(sources)
    logs = [*before, *(logs_in(sources, apart=before) if sources else ())]
    with shown_progress() as tell:
        rows = keeping.enter(logs, lambda number, count: tell("logs", number, count))
        airframes = keeping.airframes()
        tell("writing")
        _write(airframes, record, reports)
    own = {row["outcome"] for row in rows}
    code = next((_CODES[name] for name in _ORDER if name in own), 0)
    results = airframe_results(rows, airframes, code)
    if is_json():
        print_json(results)
    elif not is_silent():
        say([results["verdict"]] * bool(rows))
        say(_lines(rows, airframes))
        say(written_lines(record, reports))
    return code


def _write(airframes: dict[str, list[Entry]], record: Path | None, reports: Sequence[Path]) -> None:
    from gtmbench.report.airframe import airframe_figure, airframe_page, write_airframe_recording

    for report in reports:
        with atomic_write(report) as aside:
            if report.suffix.lower() == ".png":
                airframe_figure(airframes).savefig(aside, format="png", dpi=120)
            else:
                aside.write_text(airframe_page(airframes), encoding="utf-8")
    if record is not None:
        write_airframe_recording(airframes, record)


def _lines(rows: Sequence[dict[str, Any]], airframes: dict[str, list[Entry]]) -> list[str]:
    from gtmbench.report.airframe import airframe_lines
    from gtmbench.report.words.timeline import wrapped

    width = screen_width()
    lines = [line for row in rows for line in wrapped(f"{row['log']}: {row['verdict']}", width)]
    return lines + [line for name, flights in airframes.items() for line in airframe_lines(name, flights, width)]


def written_lines(record: Path | None, reports: Sequence[Path]) -> list[str]:
    """Say which files were written."""
    lines = [f"{'figure' if path.suffix.lower() == '.png' else 'report'}: {path}" for path in reports]
    return lines + ([] if record is None else [f"recording: {record}    look at it: gtmbench view {record}"])
