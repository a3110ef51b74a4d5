"""A monitor at work on a link's samples, for as long as its sender's clock runs on: the same engine as on a log's rows.

First the rates of the messages are measured; then rows are laid on the monitor's clock, their installation is
corrected as a log's is, and the monitor's own stream reads them. Nothing here depends on when samples arrived.
"""

from __future__ import annotations

import gc
import math
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import compress

import numpy as np

from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.assumptions import basis_of
from gtmbench.detectors.installation.learner import Corrector, Learner, expected_of, has_motion
from gtmbench.detectors.protocol import Monitor, Stream
from gtmbench.errors import GtmbenchError, InputError
from gtmbench.intake.row_by_row import is_too_seldom
from gtmbench.link.closing import Recent
from gtmbench.link.packets import LinkSample
from gtmbench.link.rows import InOrder, LinkRows, Route, measured_period
from gtmbench.link.telemetry import Message, TableRows, Telemetry
from gtmbench.log.judging.monitored import beyond
from gtmbench.log.self_check.refusal import rests_on_motion, wrong_wiring
from gtmbench.values.channels import ATTITUDE, GYROS, limit_of
from gtmbench.values.record import Record, joined

_PROBED_S = 1.5  # in which rates are measured
_PATIENCE_S = 2.5  # until a message that is needed has to be there
_MOST = 50_000  # messages until then


def wants_of(monitor: Monitor) -> tuple[str, ...]:
    """Return the channels that a monitor reads where they are there, beside those that it needs."""
    read = basis_of(monitor).witnesses
    wanted = (*read, *GYROS, *ATTITUDE) if read else ()
    return tuple(name for name in dict.fromkeys(wanted) if name not in monitor.channels)


class Watcher:
    """A monitor on one sender's samples, while its clock runs on."""

    def __init__(
        self,
        monitor: Monitor,
        reader: Telemetry | TableRows,
        learner: Learner | None = None,
        shows: Callable[[Record], object] | None = None,
        recent: Recent | None = None,
    ) -> None:
        if monitor.sample_period_s is None or not monitor.channels:
            raise InputError(f"{monitor.name} has no rate, or no channels, of its own; calibrate it on flights first")
        self._monitor = monitor
        self._reader, self._period_s, self._shows = reader, monitor.sample_period_s, shows
        self._needs, self._wants = monitor.channels, wants_of(monitor)
        if learner is None and has_motion(monitor):
            learner = Learner(self._period_s, expected_of(monitor))
        self.learner = learner
        self._corrector = None if learner is None else Corrector(learner)
        self._unchecked: list[Record] | None = None
        if learner is not None and not learner.is_settled and rests_on_motion(monitor):
            self._unchecked = []  # the first rows, whose wiring is checked before any is judged
        self._stream: Stream = monitor.stream()
        self._recent = recent
        self._probed: list[Message] = []
        self._channels: dict[str, tuple[str, ...]] = {}
        self._rows: LinkRows | None = None
        self.pending: list[LinkSample] = []
        """Samples that wait for others, to be taken together."""
        self.watched = self.heard = 0
        """Rows that could have alarmed, and all rows."""
        self.out_of_range: Counter[str] = Counter()
        """How many readings of each channel no sensor reads: they are missing."""
        self.problem = ""
        """Why these messages can't be watched by this monitor; "" where they can. A link that gets better is."""

    @property
    def armed(self) -> dict[str, bool]:
        """Whether each test statistic could alarm with the next row."""
        return dict(self._stream.armed)

    @property
    def counts(self) -> Sequence[InOrder]:
        """What was counted of each message that is read."""
        return () if self._rows is None else tuple(self._rows.counts.values())

    @property
    def left_out(self) -> int:
        """Rows for which a message is missing."""
        return 0 if self._rows is None else self._rows.left_out

    @property
    def routes(self) -> dict[str, tuple[str, ...]]:
        """The channels that each message is read for."""
        return dict(self._channels)

    def push(self, messages: Sequence[Message], at_once: int = 1) -> tuple[Alarm, ...]:
        """Return the alarms that some messages raise or tell more of, where they complete enough rows."""
        if self._rows is None:
            self._probed += messages
            messages = self._begun()
        elif self.problem:
            return ()
        self.pending += self._samples(messages)
        if not self.pending:
            return ()
        if at_once > 1 and abs(self.pending[-1].time_s - self.pending[0].time_s) < (at_once - 0.5) * self._period_s:
            return ()
        return self._hear()

    def end(self) -> tuple[Alarm, ...]:
        """Return what is left to be told, now that no message follows."""
        if self._rows is None:
            return ()
        told = self._hear()
        if self.problem:
            return told
        left = self._rows.end()
        if left is not None:
            told += self._push([left] if self._corrector is None else self._corrector.push(left))
        return told + (() if self._corrector is None else self._push(self._corrector.end()))

    def _begun(self) -> list[Message]:
        """Return the messages so far, once their rates are known."""
        stamps: dict[str, list[float]] = {}
        for message in self._probed:
            stamps.setdefault(message.topic, []).append(message.time_s)
        if not stamps:
            return []
        newest_s, first_s = max(map(max, stamps.values())), min(map(min, stamps.values()))
        span_s = newest_s - first_s
        if span_s < _PROBED_S and len(self._probed) < _MOST:
            return []
        periods_s = {topic: measured_period(at) for topic, at in stamps.items()}
        rates_hz = {topic: 1.0 / own_s for topic, own_s in periods_s.items() if 0.0 < own_s < math.inf}
        read = self._reader.routes(rates_hz, (*self._needs, *self._wants), 0.45 / self._period_s)
        lacking = [name for name in self._needs if name not in read]
        slow = [topic for topic in dict.fromkeys(read.values()) if is_too_seldom(periods_s[topic], self._period_s)]
        if (lacking or slow) and span_s < _PATIENCE_S and len(self._probed) < _MOST:
            return []
        if lacking or slow:  # as it is now: what follows is looked at anew
            self.problem = self.problem or self._problem(lacking, slow, periods_s)
            self._probed = []
            return []
        self.problem = ""
        for name, topic in read.items():
            if name in self._needs or self._is_ever_read(name, topic):
                self._channels[topic] = (*self._channels.get(topic, ()), name)
        routes = [Route(topic=topic, channels=own, period_s=periods_s[topic]) for topic, own in self._channels.items()]
        begin_s = max(min(stamps[route.topic]) for route in routes)
        slowest = max(routes, key=lambda route: route.period_s)
        start_s = min(at for at in stamps[slowest.topic] if at >= begin_s) if len(routes) > 1 else begin_s
        self._rows = LinkRows(routes, start_s, self._period_s)
        probed, self._probed = self._probed, []
        return probed

    def _is_ever_read(self, name: str, topic: str) -> bool:
        """Tell whether a channel is ever read: one that a sender leaves out throughout is nothing to wait for."""
        own = (self._reader.sample(message, (name,)) for message in self._probed if message.topic == topic)
        return any(sample is not None and math.isfinite(sample.values[0]) for sample in own)

    def _problem(self, lacking: Sequence[str], slow: Sequence[str], periods_s: dict[str, float]) -> str:
        wanted = f"{1.0 / self._period_s:.3g} Hz"
        if lacking:
            return f"no {self._reader.unit} that comes tells {', '.join(lacking)}; {self._reader.told()}"
        said = " and ".join(f"{topic or 'rows'} at {1.0 / periods_s[topic]:.3g} Hz" for topic in slow)
        return (
            f"{said}: too seldom for this monitor, which watches at {wanted}; let them come at {wanted} "
            "(--request-rates asks an autopilot for it), or take a monitor calibrated at the link's rate"
        )

    def _samples(self, messages: Sequence[Message]) -> list[LinkSample]:
        read = ((message, self._channels.get(message.topic)) for message in messages)
        made = (self._reader.sample(message, channels) for message, channels in read if channels is not None)
        return [self._inside(sample) for sample in made if sample is not None]

    def _inside(self, sample: LinkSample) -> LinkSample:
        """Return a sample without readings that no sensor reads, and count these."""
        channels = self._channels[sample.topic]
        outside = [abs(value) > limit_of(name) for value, name in zip(sample.values, channels, strict=True)]
        if not any(outside):
            return sample
        self.out_of_range.update(compress(channels, outside))
        pairs = zip(sample.values, outside, strict=True)
        return replace(sample, values=tuple(math.nan if is_outside else value for value, is_outside in pairs))

    def _hear(self) -> tuple[Alarm, ...]:
        samples, self.pending = self.pending, []
        rows = None if self._rows is None else self._rows.push(samples)
        if rows is None:
            return ()
        given = [rows] if self._corrector is None else self._corrector.push(rows)
        if self._unchecked is not None:
            self._check(rows, bool(given))
        return () if self.problem else self._push(given)

    def _check(self, rows: Record, is_due: bool) -> None:
        """Check that gyros and attitude show one motion, with the first rows that are to be judged."""
        assert self._unchecked is not None  # it is called while rows are kept
        self._unchecked.append(rows)
        if is_due:
            motion = joined(self._unchecked).select((*GYROS, *ATTITUDE))
            self._unchecked = None
            wrong = wrong_wiring(self._monitor, motion)
            if wrong:
                self.problem = f"{wrong}; nothing is watched, because healthy sensors would be accused"

    def _push(self, pieces: Sequence[Record]) -> tuple[Alarm, ...]:
        told: list[Alarm] = []
        for piece in pieces:
            if self._shows is not None:
                self._shows(piece)
            for part in [piece] if self.watched else self._seconds(piece):
                told += self._stream.push(part)
                self.heard += len(part)
                if any(self._stream.armed.values()):
                    lacking = int(np.isnan(part.matrix(self._needs)).any(axis=1).sum()) if self.left_out else 0
                    self.watched += len(part) - lacking
            if self._recent is not None and (new := self._recent.push(piece)):
                told += beyond([alarm for alarm in self._stream.alarms if alarm.is_first], new)
        return tuple(told)

    def _seconds(self, piece: Record) -> list[Record]:
        """Return a piece second by second: until something is armed, nothing of it counts as watched."""
        rows = max(round(1.0 / self._period_s), 1)
        return [piece.part(range(k, min(k + rows, len(piece)))) for k in range(0, len(piece), rows)]


_WARM_S = 40.0  # of the made-up flight
_TRIED = 20  # rows, one by one
_SHARE, _SOON_S = 0.15, 0.5  # of the time that taking rows may cost; how long they may wait for others


def warm(monitor: Monitor) -> int:
    """Let a monitor judge a made-up fault, so that the first real one waits for nothing; return its rows at once.

    A monitor that takes long for a single row, as one that was learnt on a flight does, is given several together.
    """
    period_s = float(monitor.sample_period_s or 1.0)
    count, onset = round(_WARM_S / period_s), round(0.8 * _WARM_S / period_s)
    noise = 1e-3 * np.random.default_rng(1).standard_normal((count, len(monitor.channels)))
    record = Record(noise, channels=monitor.channels, sample_period_s=period_s)
    sensor = next((name for name in GYROS if name in monitor.channels), monitor.channels[0])
    broken = record.replace(sensor, record[sensor] + 5.0 * (np.arange(count) >= onset))
    costs_s: list[float] = []
    with suppress(GtmbenchError):
        stream, stop = monitor.stream(), onset - _TRIED
        stream.push(broken.part(range(stop)))
        while stop < count:
            few = 1 if len(costs_s) < _TRIED else rows_at_once(costs_s, period_s)
            begun_s = time.perf_counter()
            stream.push(broken.part(range(stop, min(stop + few, count))))
            costs_s += [time.perf_counter() - begun_s] * (len(costs_s) < _TRIED)
            stop += few
    gc.collect()
    gc.freeze()  # what is there by now stays; looking at it again and again would cost milliseconds
    return rows_at_once(costs_s, period_s)


def rows_at_once(costs_s: Sequence[float], period_s: float) -> int:
    """Return how many rows are taken together, by what taking one costs: a small part of the time, soon enough.

    >>> rows_at_once([2e-4], 0.01), rows_at_once([2e-2], 0.01)
    (1, 14)
    """
    cost_s = float(np.median(costs_s)) if len(costs_s) else 0.0
    return int(np.clip(np.ceil(cost_s / (_SHARE * period_s)), 1, max(round(_SOON_S / period_s), 1)))
