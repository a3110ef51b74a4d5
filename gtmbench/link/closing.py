"""What arrived on a link, as a log is: learnt from at first, judged every few seconds, and all of it once it is over.

While it flies, an alarm accuses; nobody is clear before the flight is over, for only all of it tells what is usual. The
last minutes are for what comes too slowly to raise an alarm. A longer past is worse, and dearer: with five minutes two
healthy real logs of 48 are accused on the way, with two none.

What arrives is kept as a small log, and that goes through a log's own stages: the self-check, the choice of what is
fit to learn from, the bank that the channels allow, its calibration.
"""

from __future__ import annotations

import math
import tempfile
from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.bank.composed import AUTO
from gtmbench.detectors.protocol import Monitor, is_ready
from gtmbench.engine.judged import judged
from gtmbench.errors import InputError
from gtmbench.jobs.progress import Progress, silent
from gtmbench.link.packets import SavedLink
from gtmbench.link.telemetry import Message
from gtmbench.log.judging.claims import began_s, of_alarm
from gtmbench.log.learning.healthy_part import chosen
from gtmbench.log.learning.learnt_monitor import learnt
from gtmbench.log.opening.driven_attitude import FROM_LOG
from gtmbench.log.opening.engine_flight import flight_of_records
from gtmbench.log.opening.opened_log import opened
from gtmbench.log.opening.question import asked
from gtmbench.log.watch import watch_log
from gtmbench.log.watched_log import WatchedLog
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import Record, Span
from gtmbench.verdict.scope import Scope
from gtmbench.verdict.timeline import Claim, SensorSpan, laid_out
from gtmbench.verdict.verdict import LogVerdict, verdict_of

_ABOUT_S = 15.0  # of its onset: what a verdict dates so is the failure that an alarm told of
FLYING = "who is clear is told when the flight is over"


@dataclass(frozen=True, kw_only=True, eq=False)
class ClosingWord:
    """What a flight comes to once it is over."""

    verdict: LogVerdict
    # the log of what arrived, as `gtmbench monitor` watches it; None where that can't be judged
    watched: WatchedLog | None = field(default=None, repr=False)
    unconfirmed: tuple[Alarm, ...] = ()  # those that accused a sensor while it flew, and that the verdict doesn't hold


def verdict_so_far(sensors: Sequence[str], span_s: Span, alarms: Sequence[Alarm], why: str = FLYING) -> LogVerdict:
    """Return a verdict that knows the alarms alone: nobody is clear."""
    claims: dict[str, list[SensorSpan]] = {sensor: [] for sensor in sensors}
    for alarm in alarms:
        for sensor, span in of_alarm(alarm, span_s[1], sensors, ""):
            claims.setdefault(sensor, []).append(span)
    return verdict_of(laid_out(span_s, claims, motion_s=(span_s,), otherwise=why), Scope(sensors=tuple(sensors)))


def closed(
    log: Path,
    monitor: Monitor | None,
    alarms: Sequence[Alarm],
    *,
    mapping: Sequence[str],
    attitude: str,
    progress: Progress,
) -> ClosingWord:
    """Judge what has arrived, as ``gtmbench monitor LOG --detector FILE`` does; without a monitor, as ``auto``.

    `monitor`: the one that was given; None where it was learnt from the link: knowing all of it, another may be better.
    `alarms`: the first of each fault, as they were told while it flew.
    """
    watched = watch_log(log, monitor or AUTO, mapping=mapping, attitude=attitude, progress=progress)
    doubtful = tuple(alarm for alarm in alarms if alarm.accuses and not _is_held(alarm, watched.verdict))
    return ClosingWord(verdict=watched.verdict, watched=watched, unconfirmed=doubtful)


def why_not(error: InputError, log: Path) -> str:
    """Return why what was kept can't be judged, for who doesn't know the file."""
    return str(error).replace(f"{log}: ", "").replace(str(log), "the link")


def _is_held(alarm: Alarm, verdict: LogVerdict) -> bool:
    """Tell whether a verdict accuses somebody of whom an alarm told, at about that time."""
    start_s = min(began_s(alarm), alarm.onset_s) - _ABOUT_S
    end_s = math.inf if alarm.ended_s is None else max(alarm.ended_s, alarm.time_s)
    named = {*alarm.candidates, *([] if alarm.sensor is None else [alarm.sensor])}
    accused = [*verdict.failed, *verdict.suspected]
    return any((not named or sensor in named) and span.meets(start_s, end_s) for sensor, span in accused)


_NEEDS = frozenset((*GYROS, *ATTITUDE))
_PAST_S = 120.0  # that is judged
_LEAST_S = 30.0  # less tells no constants
_WORKS_S = 5.0  # of the sender's clock, for half a second of work, seldom three; and as long until the next


class Recent:
    """What arrived last, judged every ten seconds of the sender's clock: the work is bounded, however long it flies.

    It is done beside the watch, so that no alarm of a monitor comes later by it, and told a fixed time later, so that a
    saved link tells the same.

    `is_driven`, `is_assumed`: whether the gyros drive the attitude, and whether that is only assumed.
    """

    def __init__(self, *, is_driven: bool, is_assumed: bool) -> None:
        self._is_driven, self._is_assumed = is_driven, is_assumed
        self._rows: deque[Record] = deque()
        self._works = ThreadPoolExecutor(max_workers=1, thread_name_prefix="recent")
        self._asked: Future[tuple[Alarm, ...]] | None = None
        self._due_s: float | None = None
        self._accused_s: dict[str, float] = {}  # when each was accused last: what began before is the same failure
        self._told = 0

    def push(self, rows: Record) -> tuple[Alarm, ...]:
        """Return the alarms of whom the engine accuses and hasn't accused before, as known with these rows."""
        if not _NEEDS.issubset(rows.channels):
            return ()
        if self._due_s is None:
            self._due_s = rows.start_s + _LEAST_S
        told: list[Alarm] = []
        while rows.end_s >= self._due_s:
            count = int(np.searchsorted(rows.time_s, self._due_s)) + 1
            self._rows.append(rows.part(range(count)))
            told += self._turned(float(rows.time_s[count - 1]))
            self._due_s = float(rows.time_s[count - 1]) + _WORKS_S
            if count == len(rows):
                return tuple(told)
            rows = rows.part(range(count, len(rows)))
        self._rows.append(rows)
        return tuple(told)

    def _turned(self, now_s: float) -> list[Alarm]:
        """Ask for what the engine says, or return what it says."""
        if self._asked is None:
            self._ask(now_s)
            return []
        alarms, self._asked = self._asked.result(), None
        return [alarm for each in alarms if (alarm := self._new(each, now_s)) is not None]

    def _ask(self, now_s: float) -> None:
        while self._rows[0].end_s < now_s - _PAST_S:
            self._rows.popleft()
        past = list(self._rows)
        if all(any(np.isfinite(each[name]).any() for each in past) for name in _NEEDS):
            self._asked = self._works.submit(
                lambda: judged(flight_of_records(past, is_driven=self._is_driven, is_assumed=self._is_assumed)).alarms
            )

    def _new(self, alarm: Alarm, now_s: float) -> Alarm | None:
        """Return an alarm as it is known now; None where it names nobody, or tells of what was told before."""
        if alarm.sensor is None:
            return None
        is_new = alarm.onset_s > self._accused_s.get(alarm.sensor, -np.inf)
        self._accused_s[alarm.sensor] = now_s
        if not is_new:
            return None
        known = tuple(replace(each, time_s=now_s) for each in alarm.judgements)
        self._told += 1
        return replace(alarm, number=self._told - 1, fault=-1, time_s=now_s, judgements=known, ended_s=None)


_MOST = 2_000_000  # packets or lines


class Lesson:
    """The span of a link that a monitor is learnt from."""

    def __init__(
        self,
        learn_s: float,
        *,
        is_table: bool,
        mapping: Sequence[str] = (),
        system: int | None = None,
        attitude: str = FROM_LOG,
    ) -> None:
        self._learn_s, self._is_table, self._mapping = learn_s, is_table, tuple(mapping)
        self.system, self._attitude = system, attitude
        self._header = b""
        self._parts: deque[tuple[float, bytes]] = deque(maxlen=_MOST)
        self._first_s: float | None = None
        self._newest_s = 0.0

    @property
    def time_s(self) -> float | None:
        """The newest stamp."""
        return None if self._first_s is None else self._newest_s

    def take(self, arrived_s: float, parts: Sequence[bytes], messages: Sequence[Message]) -> bool:
        """Keep what arrived; tell whether it is enough."""
        for part in parts:
            if self._is_table and not self._header:
                self._header = part
            else:
                self._parts.append((arrived_s, part))
        for message in messages:
            if self._first_s is None or not -2.0 <= message.time_s - self._newest_s <= self._learn_s:
                self._first_s = self._newest_s = message.time_s
            self._newest_s = max(self._newest_s, message.time_s)
        return self._first_s is not None and self._newest_s - self._first_s >= self._learn_s

    def learnt(self) -> tuple[Monitor | None, str]:
        """Return the monitor and what it was learnt from, or none and why not; half of the span is kept then."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "link.csv" if self._is_table else "link.tlog")
            self._write(path)
            log = path if self.system is None or self._is_table else Path(f"{path}:{self.system}")
            try:
                question = asked(
                    log,
                    AUTO,
                    healthy=[(-float("inf"), float("inf"))],
                    mapping=self._mapping,
                    rate_hz=None,
                    false_alarms_per_hour=None,
                    attitude=self._attitude,
                )
                link = opened(question)
                if link.judged is not None and link.judged.accused:
                    self._forget()
                    return None, _accused_text(link.judged.accused)
                taught = learnt(chosen(link), silent)
            except InputError as error:
                self._forget()
                return None, why_not(error, path)
        if not (taught.check.passed and is_ready(taught.monitor)):
            self._forget()
            return None, "; ".join([*map(str, taught.check.stops), *map(str, taught.check.doubts)]) or "it is no flight"
        (start_s, end_s), *_ = taught.identified_s or ((0.0, 0.0),)
        return taught.monitor, f"learnt from {end_s - start_s:.0f} s"

    def _write(self, path: Path) -> None:
        with SavedLink(path, is_table=self._is_table) as saved:
            for arrived_s, part in [(0.0, self._header)] * self._is_table + [*self._parts]:
                saved.put(arrived_s, part)

    def _forget(self) -> None:
        for _ in range(len(self._parts) // 2):
            self._parts.popleft()
        if self._first_s is not None:
            self._first_s += 0.5 * (self._newest_s - self._first_s)


def _accused_text(accused: Sequence[Claim]) -> str:
    """Say whom the engine accuses in what a monitor would be learnt from."""
    who = list(dict.fromkeys(sensor for sensor, _ in accused))
    since_s = min(span.start_s for _, span in accused)
    return f"{', '.join(who)} {'failed' if len(who) == 1 else 'may have failed'} since {since_s:.0f} s"
