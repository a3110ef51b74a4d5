"""A live recording in a process of its own: rerun may block, or die, and the watch goes on without it.

The watch hands rows and events to a queue; a thread carries them through a pipe; the process draws. What a live link
brings while the queue is full is left out of the picture, and counted; a saved link waits instead.
"""

from __future__ import annotations

import multiprocessing
import os
import queue
import signal
import tempfile
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

from gtmbench.checks import one_line
from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.protocol import Monitor
from gtmbench.errors import GtmbenchError, InputError
from gtmbench.link.events import LiveEvent, LiveKind
from gtmbench.values.record import Record

_REST = 3.0  # of what a drawing took, until the next
_LONGEST_S = 60.0  # of rows that wait to be drawn
_END_S = 30.0  # for what is left at the end
_STUCK = "rerun takes no more"
_DIED = 'the process that draws ended too early; a script needs its `if __name__ == "__main__":`'
_SEVERITY = {
    LiveKind.ALARM: "ERROR",
    LiveKind.NAMED: "CRITICAL",
    LiveKind.CANNOT_TELL: "WARN",
    LiveKind.LINK_LOST: "WARN",
}


class DrawnEvent(NamedTuple):
    """What is drawn of an event."""

    time_s: float
    severity: str
    text: str
    alarm: Alarm | None


class DrawnFiles(NamedTuple):
    """What became of a recording: the files, one for each clock; rows left out; what went wrong; the file asked for."""

    paths: tuple[Path, ...] = ()
    left_out: int = 0
    failure: str = ""
    path: Path | None = None


class Pictures:
    """What is drawn of a watch: a file, the viewer, both or nothing."""

    def __init__(self, path: Path | None = None, *, views: bool = False) -> None:
        self._targets = [*([] if path is None else [path]), *([None] if views else [])]
        self._showings: list[Showing] = []
        self._before: list[LiveEvent] = []  # before anything is watched
        self.drawn: tuple[DrawnFiles, ...] = ()
        """What became of each, at the end."""

    def begin(self, monitor: Monitor, *, waits: bool) -> None:
        """Draw from now on what a monitor reads."""
        self._showings = [Showing(monitor, target, waits=waits) for target in self._targets]
        for event in self._before:
            self.event(event)
        self._before = []

    def rows(self, rows: Record) -> None:
        """Draw rows that are judged."""
        for showing in self._showings:
            showing.rows(rows)

    def event(self, event: LiveEvent) -> None:
        """Draw an event."""
        if self._targets and not self._showings:
            self._before.append(event)
        for showing in self._showings:
            showing.event(event)

    def end(self, verdict: Mapping[str, object]) -> None:
        """Wait until all is drawn."""
        showings, self._showings = self._showings, []
        self.drawn += tuple(showing.end(verdict) for showing in showings)


class Showing:
    """Hands what a watch reads and says to a process that draws it."""

    def __init__(self, monitor: Monitor, path: Path | None, *, waits: bool) -> None:
        self._path, self._waits = path, waits
        self._left_out = 0  # rows
        self._rows: list[Record] = []
        self._queue: queue.Queue[Any] = queue.Queue(2000)  # hand-overs that wait
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=draw, args=(theirs, monitor, path), daemon=True)
        self._process.start()
        self.pid = self._process.pid
        theirs.close()
        self._carrier = threading.Thread(target=self._carry, daemon=True)
        self._carrier.start()

    def rows(self, rows: Record) -> None:
        """Hand over some rows."""
        self._rows.append(rows)
        # rows of 0.2 s are handed over at once
        if rows.end_s - self._rows[0].start_s >= 0.2 or rows.end_s < self._rows[0].start_s:
            self._flush()

    def event(self, event: LiveEvent) -> None:
        """Hand over an event, behind the rows before it."""
        self._flush()
        if event.time_s is not None:
            self._put(
                DrawnEvent(event.time_s, _SEVERITY.get(event.kind, "INFO"), f"{event.kind}: {event.text}", event.alarm)
            )

    def end(self, verdict: Mapping[str, object]) -> DrawnFiles:
        """Hand over the verdict, and wait until all is drawn."""
        self._flush()
        with suppress(queue.Full):
            self._queue.put(dict(verdict), timeout=_END_S)
        with suppress(queue.Full):
            self._queue.put(None, timeout=_END_S)
        self._carrier.join(_END_S)
        drawn = DrawnFiles(failure=_STUCK)
        try:
            if not self._carrier.is_alive() and self._pipe.poll(_END_S):
                drawn = self._pipe.recv()
        except (EOFError, OSError):
            drawn = DrawnFiles(failure=_DIED)
        self._process.join(1.0)
        if self._process.is_alive():
            self._process.terminate()
        self._pipe.close()
        failure = drawn.failure and _why_undrawn(drawn.failure, self._path)
        return drawn._replace(left_out=self._left_out, failure=failure, path=self._path)

    def _flush(self) -> None:
        rows, self._rows = self._rows, []
        if rows and not self._put(rows):
            self._left_out += sum(map(len, rows))

    def _put(self, frame: object) -> bool:
        """Put something into the queue, and tell whether there was room."""
        try:
            self._queue.put(frame, block=self._waits and self._carrier.is_alive(), timeout=_END_S)
        except queue.Full:
            return False
        return True

    def _carry(self) -> None:
        with suppress(OSError):  # the process ended: nobody takes anything any more
            while (frame := self._queue.get()) is not None:
                self._pipe.send(frame)
            self._pipe.send(None)


def _why_undrawn(why: str, path: Path | None) -> str:
    """Say what isn't drawn; of a full disk rerun tells nothing, so its folder is asked for room."""
    if path is None:
        return f"the rerun viewer ended before the flight: {why}"
    try:
        with tempfile.TemporaryFile(dir=path.parent) as file:
            file.write(bytes(1 << 20))  # rerun hands over at most so much at once
    except OSError as error:
        why = error.strerror or why
    return f"not all recorded: {path}: {why}; it holds what came before, if anything"


def draw(pipe: Connection, monitor: Monitor, path: Path | None) -> None:
    """Draw what comes through a pipe until it ends; the work of the process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the watch, and that ends the pipe
    with suppress(OSError, AttributeError):
        os.nice(10)
    with suppress(OSError), Path(os.devnull).open("wb") as nowhere:
        os.dup2(nowhere.fileno(), 2)  # rerun's own complaints; what matters of them is said at the end
    try:
        drawn = DrawnFiles(_Drawing(monitor, path).run(pipe))
    except Exception as error:  # whatever it is, the watch goes on, and says it at the end
        drawn = DrawnFiles(failure=one_line(str(error)) or type(error).__name__)
    with suppress(OSError):
        pipe.send(drawn)


class _Drawing:
    """Recordings that are drawn: one for each clock of the sender."""

    def __init__(self, monitor: Monitor, path: Path | None) -> None:
        import rerun as rr

        rr.set_strict_mode(True)
        self._monitor, self._path = monitor, path
        self._every_s = 0.5 if path is None else 5.0  # seconds between two drawings
        self._paths: list[Path] = []
        self._begin()

    def _begin(self) -> None:
        import rerun as rr

        from gtmbench.report.recording.read import opened_viewer
        from gtmbench.report.recording.watch import LiveRecording

        self._stream = rr.RecordingStream("gtmbench")
        if self._path is None:
            self._stream.connect_grpc(opened_viewer())
        else:
            number = len(self._paths) + 1
            path = self._path if number == 1 else self._path.with_stem(f"{self._path.stem}-{number}")
            self._stream.save(path)
            self._paths.append(path)
        self._drawn = LiveRecording(self._monitor, self._stream)

    def run(self, pipe: Connection) -> tuple[Path, ...]:
        """Draw until the pipe ends, and return the files."""
        is_open, due_s = True, 0.0
        verdict: Mapping[str, object] = {}
        while is_open:
            frames = 0
            while is_open and frames < 500 and pipe.poll(0.05):  # so many are drawn at once
                try:
                    frame = pipe.recv()
                except EOFError:
                    frame = None
                frames += 1
                if frame is None:
                    is_open = False
                elif isinstance(frame, dict):
                    verdict = frame
                else:
                    self._take(frame)
            began_s = time.monotonic()
            if began_s >= due_s or self._drawn.waiting_s > _LONGEST_S:
                self._drawn.draw()
                due_s = time.monotonic() + max(self._every_s, _REST * (time.monotonic() - began_s))
        self._finish(verdict)
        return tuple(self._paths)

    def _take(self, frame: DrawnEvent | list[Record]) -> None:
        if isinstance(frame, DrawnEvent):
            self._drawn.tell(*frame)
            return
        for rows in frame:
            end_s = self._drawn.end_s
            if end_s is not None and rows.start_s < end_s:  # the sender's clock began anew
                self._finish({})
                self._begin()
            self._drawn.take(rows)

    def _finish(self, verdict: Mapping[str, object]) -> None:
        self._drawn.end(verdict)
        self._stream.flush(timeout_sec=_END_S)
        self._stream.disconnect()
        # up to this size a file is read once more: rerun tells of no full disk
        if self._paths and self._paths[-1].stat().st_size < 300_000_000:
            from gtmbench.report.recording.read import check_recording

            try:
                check_recording(self._paths[-1])
            except InputError as error:
                raise GtmbenchError("rerun left it cut") from error
