"""`gb.live`: a link watched while it flies, event by event."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from gtmbench.checks import number, whole
from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.assumptions import basis_of
from gtmbench.detectors.monitor_file import load_monitor
from gtmbench.detectors.protocol import Detector, Monitor, is_ready
from gtmbench.errors import InputError
from gtmbench.jobs.progress import Progress, silent
from gtmbench.link.closing import ClosingWord, Lesson, closed, verdict_so_far, why_not
from gtmbench.link.events import LiveEvent, LiveKind, Saying
from gtmbench.link.packets import SavedLink, dialect
from gtmbench.link.showing import DrawnFiles, Pictures
from gtmbench.link.source import Delivery, LinkSource, source_of
from gtmbench.link.telemetry import Message, TableRows, Telemetry
from gtmbench.link.watched_link import LinkCounts, Session
from gtmbench.link.watcher import wants_of, warm
from gtmbench.log.opening.driven_attitude import FROM_LOG, check_attitude
from gtmbench.report.words.verdict import first_line
from gtmbench.values.attitude_estimators import OWN
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.verdict.verdict import Outcome

_LEARNT = (*GYROS, *ATTITUDE)  # what a table has to hold to be learnt from
_BEHIND, _TOGETHER = 32, 256  # deliveries that wait, from which on rows are taken together, and how many


@dataclass(frozen=True, kw_only=True)
class LinkOptions:
    """How a link is read, and what is done beside watching it; see `live`."""

    learn_s: float = 60.0
    system: int | None = None
    mapping: Sequence[str] = ()
    attitude: str = FROM_LOG
    key: bytes | None = field(default=None, repr=False)
    save: Path | None = None
    record: Path | None = None
    view: bool = False
    say: bool = False
    request_hz: float | None = None
    end_after_s: float | None = None


class Live:
    """A link that is being watched: iterate over its events; close it, or use it in a ``with`` block.

    Once it has ended, or is closed, what arrived is judged as a whole, as ``gtmbench monitor`` judges the log that was
    kept of it.

    Attributes
    ----------
    counts : LinkCounts
        The treatment of the link's messages so far.
    outcome : Outcome
        The verdict: so far failed, or unknown, for nobody is clear before the flight is over.
    verdict : str
        The verdict in one sentence.
    closing : ClosingWord or None
        What the flight comes to; None while it lasts.
    monitor : Monitor or None
        The monitor that watches; None while one is learnt.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import gtmbench as gb
    >>> record = gb.Record([[0.0] * 6] * 500, channels=["p", "q", "r", "phi", "theta", "psi"], sample_period_s=0.01)
    >>> monitor = gb.load_monitor(Path(gb.__file__).with_name("baselines") / "bank-C.json")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     gb.send_live(record, Path(folder, "flight.tlog"))
    ...     with gb.live(f"{folder}/flight.tlog", monitor) as link:
    ...         print(len(list(link)), link.verdict, link.counts)
    0 Cannot tell: nothing moves. 1000 messages read
    """

    def __init__(self, source: LinkSource, monitor: Monitor | None, options: LinkOptions) -> None:
        self._source, self._options = source, options
        with ExitStack() as stack:
            stack.callback(source.close)  # also where nothing can be watched
            self.monitor = monitor
            self._given = monitor
            self._closing: ClosingWord | None = None
            self._is_over = False
            self._reader = self._reader_of(monitor)
            self._session: Session | None = None
            self._learn: Lesson | None = None
            self._pictures = Pictures(options.record, views=options.view)
            if monitor is None:
                self._learn = Lesson(
                    options.learn_s,
                    is_table=source.is_table,
                    mapping=options.mapping,
                    system=options.system,
                    attitude=options.attitude,
                )
            else:
                self._session = self._session_of(monitor)
            self._saying: Saying | None = None
            self._said = ""
            self._has_dropped = False
            self._asks = options.request_hz is not None
            self._arrived_s = self._heard_s = 0.0  # of bytes, and of what could be read
            self._at_once = 1
            folder = stack.enter_context(tempfile.TemporaryDirectory())
            kept = Path(folder, "link.csv" if source.is_table else "link.tlog")
            self._kept = stack.enter_context(SavedLink(options.save or kept, is_table=source.is_table))
            self._has_told_loss = False
            self._stack = stack.pop_all()
        self._events = self._watched()

    def _session_of(self, monitor: Monitor) -> Session:
        is_own = self._options.attitude == OWN
        return Session(monitor, self._reader, self._pictures.rows, is_own=is_own)

    def _reader_of(self, monitor: Monitor | None) -> Telemetry | TableRows:
        if not self._source.is_table:
            dialect()  # without its library, that is said before anybody waits
            return Telemetry(self._options.system, self._options.key)
        needs = _LEARNT if monitor is None else monitor.channels
        return TableRows(needs, () if monitor is None else wants_of(monitor), self._options.mapping)

    def __iter__(self) -> Iterator[LiveEvent]:
        """Return itself: events are given once."""
        return self

    def __next__(self) -> LiveEvent:
        """Return the next event; wait for it."""
        return next(self._events)

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, _type: object, error: BaseException | None, _trace: object) -> None:
        """Close it; what an error ended isn't judged."""
        if error is not None:
            self._closing = self._unjudged("the watch ended by an error")
        self.close()

    def close(self, progress: Progress = silent) -> None:
        """Stop listening, judge what has arrived, and finish what is saved and recorded.

        Parameters
        ----------
        progress : callable
            While it is judged: called with the step, the number done and the total.
        """
        self._events.close()
        self._source.close()
        self._over()
        if self._closing is None:
            self._closing = self._closed(progress)
        self._stack.close()
        self._pictures.end({"verdict": self.verdict, "outcome": self.outcome.name.lower()})

    def _over(self) -> None:
        """Nothing arrives any more: what was kept is a whole log."""
        self._kept.close()
        self._is_over = True

    @property
    def closing(self) -> ClosingWord | None:
        """What the flight comes to; None while it lasts."""
        if self._closing is None and self._is_over:
            self._closing = self._closed(silent)
        return self._closing

    def _closed(self, progress: Progress) -> ClosingWord:
        """Return what the flight comes to; where its log can't be judged, what the alarms say, and why."""
        options, kept = self._options, self._kept
        if kept.failure:
            return self._unjudged(f"what arrived isn't all saved: {kept.failure}")
        if not self._arrived_s:
            return self._unjudged("nothing came")
        of_system = self._source.is_table or options.system is None
        log = kept.path if of_system else Path(f"{kept.path}:{options.system}")
        told = () if self._session is None else self._session.first_alarms
        try:
            return closed(log, self._given, told, mapping=options.mapping, attitude=options.attitude, progress=progress)
        except InputError as error:
            return self._unjudged(why_not(error, kept.path))
        except KeyboardInterrupt:  # nobody wants to wait for it
            return self._unjudged("it was ended before all that arrived was judged")

    def _unjudged(self, why: str) -> ClosingWord:
        if self._session is None:
            return ClosingWord(verdict=verdict_so_far(GYROS, (0.0, 0.0), (), why))
        return ClosingWord(verdict=self._session.verdict(why))

    @property
    def drawn(self) -> tuple[DrawnFiles, ...]:
        """The recordings, once it is closed: their files, and what they lack."""
        return self._pictures.drawn

    @property
    def unsaved(self) -> str:
        """Why what arrived isn't all saved, and which file lacks it; "" where it is."""
        return self._kept.failure

    @property
    def counts(self) -> LinkCounts:
        """The treatment of the link's messages so far."""
        return LinkCounts(dropped=self._source.dropped) if self._session is None else self._session.counts

    @property
    def outcome(self) -> Outcome:
        """The verdict: so far failed, or unknown, for nobody is clear before the flight is over."""
        if self.closing is not None:
            return self.closing.verdict.outcome
        return Outcome.UNKNOWN if self._session is None else self._session.outcome

    @property
    def watched_s(self) -> float:
        """For how long an alarm was possible, in seconds of the sender's clock."""
        return 0.0 if self._session is None else self._session.watched_s

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """The faults so far that something is left of to explain."""
        return () if self._session is None else tuple(self._session.alarms)

    @property
    def verdict(self) -> str:
        """The verdict in a sentence or two."""
        if self.closing is not None:
            return first_line(self.closing.verdict)
        if self._session is None:
            return "Cannot tell yet: no monitor is learnt."
        return first_line(self._session.verdict())

    def _watched(self) -> Generator[LiveEvent, None, None]:
        for event in self._heard():
            self._pictures.event(event)
            yield event

    def _heard(self) -> Iterator[LiveEvent]:
        if self.monitor is None:
            yield self._event(LiveKind.LEARNING, f"learning from {self._options.learn_s:g} s of this link")
        else:
            self._begin(self.monitor)
        self._heard_s = time.time() if self._source.is_live else 0.0
        for delivery in self._source.deliveries():
            now_s = time.time() if delivery is None else delivery.arrived_s
            for event in self._quiet(now_s) if delivery is None else self._read(delivery):
                if self._saying is not None:
                    self._saying.say(event)
                yield event
            if self._saying is not None:
                self._saying.tick()
            if self._options.end_after_s is not None and now_s - self._heard_s > self._options.end_after_s:
                break
        if self._source.is_table:
            yield from self._read(Delivery(self._arrived_s, b""), is_last=True)
        if self._session is not None:
            yield from self._session.end()
        if self._source.ended:
            yield self._event(LiveKind.NOTE, self._source.ended)
        self._over()

    def _begin(self, monitor: Monitor) -> None:
        self._pictures.begin(monitor, waits=not self._source.is_live)
        if self._source.is_live:
            self._at_once = warm(monitor)

    def _quiet(self, now_s: float) -> Iterable[LiveEvent]:
        return () if self._session is None else self._session.tick(now_s)

    def _read(self, delivery: Delivery, *, is_last: bool = False) -> Iterator[LiveEvent]:
        self._arrived_s, reader = delivery.arrived_s, self._reader
        messages = reader.read(delivery.data, delivery.peer, is_whole=self._source.is_whole or is_last)
        if messages or (reader.taken and not self._source.is_table):
            self._heard_s = delivery.arrived_s
        yield from self._saved(delivery.arrived_s)
        self._speak()
        if self._session is None:
            yield from self._learning(delivery.arrived_s, messages)
            return
        self._session.dropped = self._source.dropped
        self._session.at_once = self._at_once if self._source.waiting < _BEHIND else _TOGETHER
        yield from self._session.take(messages, delivery.arrived_s)
        if self._source.dropped and not self._has_dropped:
            self._has_dropped = True
            yield self._session.note("the link brings more than can be watched: parts of it are dropped, and counted")

    def _saved(self, arrived_s: float) -> Iterator[LiveEvent]:
        for part in self._reader.taken:
            self._kept.put(arrived_s, part)
        if self._kept.failure and not self._has_told_loss:
            self._has_told_loss = True
            yield self._event(LiveKind.NOTE, self._kept.failure)

    def _speak(self) -> None:
        """Begin to speak on the link, once it is known whose it is."""
        reader, options = self._reader, self._options
        if not isinstance(reader, Telemetry):
            return
        if self._asks and reader.answered is not None:
            self._asks = False
            Saying(self._source.send, reader.answered).request(options.request_hz or 0.0)
        if options.say and self._saying is None and reader.system is not None:
            self._saying = Saying(self._source.send, reader.system)

    def _learning(self, arrived_s: float, messages: list[Message]) -> Iterator[LiveEvent]:
        lesson, reader = self._learn, self._reader
        assert lesson is not None  # there is no monitor yet
        if reader.is_open:
            if reader.is_open != self._said:
                self._said = reader.is_open
                yield self._event(LiveKind.CANNOT_TELL, self._said)
            return
        lesson.system = getattr(reader, "system", None)
        if not lesson.take(arrived_s, reader.taken, messages):
            return
        monitor, why = lesson.learnt()
        if monitor is None:
            yield self._event(LiveKind.CANNOT_TELL, f"nothing can be learnt from this span yet: {why}")
            return
        self.monitor = monitor
        later = "`gtmbench monitor` may choose otherwise afterwards, knowing the whole flight"
        text = f"{why}: {basis_of(monitor).title}; {later}"
        yield self._event(LiveKind.LEARNING, text)
        self._begin(monitor)
        if isinstance(reader, TableRows):
            kept = reader.channels
            missing = [name for name in monitor.channels if name not in kept]
            if missing:
                raise InputError(f"the table's first lines hold no {', '.join(missing)}, and the monitor reads them")
        self._learn, self._session = None, self._session_of(monitor)

    def _event(self, kind: LiveKind, text: str) -> LiveEvent:
        time_s = self._learn.time_s if self._learn is not None else None
        time_s = self._session.time_s if self._session is not None else time_s
        return LiveEvent(kind=kind, time_s=time_s, text=text, arrived_s=self._arrived_s, said_s=time.time())


def live(
    source: str | LinkSource,
    monitor: Monitor | str | Path | None = None,
    *,
    learn_s: float = 60.0,
    system: int | None = None,
    mapping: Sequence[str] = (),
    attitude: str = "auto",
    key: bytes | None = None,
    save: str | Path | None = None,
    record: str | Path | None = None,
    view: bool = False,
    say: bool = False,
    request_hz: float | None = None,
    only_from: str = "",
    speed: float | None = None,
    end_after_s: float | None = None,
) -> Live:
    """Watch a flight while it flies: open a link, and give what a monitor says as it becomes known.

    Parameters
    ----------
    source : str
        ``udp:HOST:PORT`` (listens there), ``tcp:HOST:PORT`` (connects), ``serial:DEVICE:BAUD``, a telemetry log
        (.tlog), ``follow:FILE.csv`` for a file that grows, or ``-`` for lines of CSV on standard input, header first.
    monitor : Monitor, str or Path, optional
        A calibrated monitor, or its file. Without one, a monitor is learnt from the link's first `learn_s`.
    learn_s : float
        In seconds of the sender's clock.
    system : int, optional
        The MAVLink system that is watched, if several fly on one link.
    mapping : sequence of str
        For lines: as `open_log` takes it.
    attitude : str
        "own" where no estimator makes it of the gyros, as in a simulation; else it is taken for an estimator's
        ("driven"), and a monitor that was calibrated for one of its own is believed a first fault only, while it flies.
    key : bytes, optional
        The 32 bytes of a signing key; MAVLink that isn't signed by it is refused.
    save : str or Path, optional
        Write every packet to this telemetry log, in order of arrival.
    record : str or Path, optional
        Record readings, predictions, test statistics and events into this file (.rrd) while it flies, by a process of
        its own; a script needs its ``if __name__ == "__main__":`` then, as for `view`.
    view : bool
        Show them in the rerun viewer as they come.
    say : bool
        Send STATUSTEXT and a heartbeat back, for the ground station.
    request_hz : float, optional
        Ask the autopilot to send its gyros and attitude at this rate.
    only_from : str
        For UDP: the address, or ``ADDRESS:PORT``, that is believed; others are ignored.
    speed : float, optional
        For a telemetry log: how many times its own speed; by default as fast as it is read.
    end_after_s : float, optional
        End after so many seconds without a message; by default a link has no end.

    Returns
    -------
    Live
        An iterator of `LiveEvent`, and a context manager that closes the link.

    Raises
    ------
    InputError
        If the source can't be opened, or the monitor isn't calibrated or has no sample period of its own.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import gtmbench as gb
    >>> flight = gb.measure(gb.fly("gtm", "multisine+turbulence", 60, seed=1), noise="t2", seed=1)
    >>> broken = gb.inject(flight, gb.Bias(channel="q", onset_s=50, size=8))
    >>> monitor = gb.load_monitor(Path(gb.__file__).with_name("baselines") / "bank-C.json")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     gb.send_live(broken, Path(folder, "flight.tlog"))
    ...     with gb.live(f"{folder}/flight.tlog", monitor) as link:
    ...         print([event.kind.value for event in link][:2], link.outcome.name)
    ['watching', 'alarm'] FAILED
    """
    if isinstance(monitor, str | Path):
        monitor = load_monitor(monitor)
    monitor = ready(monitor)
    options = LinkOptions(
        learn_s=number("learn_s", learn_s, 10.0, 3600.0),
        system=None if system is None else whole("system", system, 1, 255),
        mapping=tuple(mapping),
        attitude=check_attitude(attitude),
        key=key,
        save=None if save is None else Path(save),
        record=None if record is None else Path(record),
        view=view,
        say=say,
        request_hz=None if request_hz is None else number("request_hz", request_hz, 0.1, 1000.0),
        end_after_s=None if end_after_s is None else number("end_after_s", end_after_s, 0.0, 86400.0, above=True),
    )
    opened = source_of(source, speed=speed, only=only_from) if isinstance(source, str) else source
    return Live(opened, monitor, options)


def ready(monitor: Monitor | Detector | None) -> Monitor | None:
    """Return what watches a link as it is, or refuse it."""
    if monitor is None:
        return None
    if not is_ready(monitor):
        raise InputError(
            f"the detector '{monitor.name}' isn't calibrated, and a link can't wait for that; run: gtmbench calibrate "
            "--detector NAME --out monitor.json, then give --detector monitor.json, or none to learn from the link"
        )
    if monitor.sample_period_s is None or not monitor.channels:
        raise InputError(
            f"{monitor.name} has no rate, or no channels, of its own; give a monitor calibrated on flights"
        )
    return monitor
