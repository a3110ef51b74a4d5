"""The cross-check: what the engine says of the sensors that no gyro enters, and of them alone.

It learns nothing. A recorded flight is judged as a whole (`gtmbench monitor LOG --detector cross-check`); a record, or
a stream, by its last two minutes, every ten seconds, so that every alarm could be raised when it says.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from gtmbench.checks import number
from gtmbench.detectors.adapt import CROSS_CHECK
from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.assumptions import Basis
from gtmbench.detectors.base import BaseMonitor
from gtmbench.detectors.buffered_stream import RollingBuffer
from gtmbench.detectors.gate import gated
from gtmbench.detectors.protocol import Watch
from gtmbench.detectors.tables import PERIODS_S, keys
from gtmbench.engine.course.judged import course_beside, course_judged
from gtmbench.engine.course.relations.registry import compared
from gtmbench.engine.judged import judged
from gtmbench.engine.samples import Samples, flight_of
from gtmbench.errors import InputError
from gtmbench.jobs.progress import Progress, silent
from gtmbench.method.problem import taught_records
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, GPS_VELOCITY, GYROS, MAGNETOMETER
from gtmbench.values.record import Record
from gtmbench.verdict.timeline import Claim

_SIX = (*GYROS, *ATTITUDE)
_OTHERS = (*ACCELEROMETERS, *GPS_VELOCITY, *MAGNETOMETER, "tas", "alpha", "beta", "altitude")
_PAST_S, _LOOK_S = 120.0, 10.0  # as on a link: a longer past accuses more of what is healthy
_LEAST_S = 40.0  # less tells no constants, and nobody is accused who has broken within the last 20 s
_FEWEST = 20  # readings of a channel in that past
_BASIS = Basis(title=CROSS_CHECK, kinematic=GYROS, attitude_from_gyros=True, is_whole=True)


@dataclass(frozen=True, kw_only=True)
class CrossCheck:
    """A detector of faults of magnetometer, GPS, accelerometers, air data and altitude: the engine's course.

    A record needs gyros and attitude, which the gyros may drive, and what it holds of mag_x, mag_y, mag_z, gps_north,
    gps_east, gps_down, nx, ny, nz, tas (with alpha and beta) and altitude. No gyro and no angle is ever named.

    Attributes
    ----------
    name : str
    channels : tuple of str
        Empty: it takes what is there.

    Examples
    --------
    >>> import gtmbench as gb
    >>> truth = gb.fly("gtm", "doublets", 130.0, seed=1)
    >>> flight = gb.with_gps(gb.measure(truth, noise="t2"), truth, gb.Gps())
    >>> monitor = gb.CrossCheck().calibrate([flight])
    >>> pulled = gb.inject(flight, gb.Bias(channel="nz", onset_s=80.0, size=0.3))
    >>> monitor.watch(pulled).alarms[0].verdict, monitor.watch(flight).alarms
    ('accelerometers (nz) failed', ())
    """

    name: str = CROSS_CHECK
    channels: tuple[str, ...] = ()

    @property
    def basis(self) -> Basis:
        """What it rests on: the whole log, its gyros and its attitude."""
        return _BASIS

    def calibrate(
        self, records: Sequence[Record], false_alarms_per_hour: float | None = None, *, progress: Progress = silent
    ) -> CrossCheckMonitor:
        """Return a monitor of the channels that records share; it learns nothing else, and promises no rate.

        Raises
        ------
        InputError
            If a rate is asked for, or a record lacks gyros, attitude, or two sensors to compare.
        """
        if false_alarms_per_hour is not None:
            raise InputError(
                f"'{self.name}' can't promise {false_alarms_per_hour:g} false alarms an hour; leave the rate out"
            )
        progress("learn", 0, 1)
        healthy = taught_records(records)
        for record in healthy:
            record.columns(_SIX)
        used = tuple(name for name in (*_SIX, *_OTHERS) if all(name in each for each in healthy))
        return self.restore({"sample_period_s": healthy[0].sample_period_s, "channels": list(used)})

    def restore(
        self, figures: Mapping[str, Any], provenance: Mapping[str, Any] = MappingProxyType({})
    ) -> CrossCheckMonitor:
        """Return the monitor of some figures."""
        if "learnt" in figures:
            raise InputError(
                "it holds bounds that a cross-check once learnt, and this one learns none: type --detector cross-check "
                "instead, or run `gtmbench calibrate` anew"
            )
        table = keys("figures", figures, ("sample_period_s", "channels"))
        channels = tuple(table["channels"])
        if not compared(channels):
            raise InputError(
                f"the cross-check finds no two sensors to compare (found: {', '.join(channels)}); it compares GPS "
                "velocity, accelerometers, tas and altitude with each other, and a magnetometer with the attitude"
            )
        return CrossCheckMonitor(
            name=self.name,
            channels=channels,
            sample_period_s=number("sample_period_s", table["sample_period_s"], *PERIODS_S),
            suspects=tuple(dict.fromkeys(sensor for each in compared(channels) for sensor in each)),
            provenance=dict(provenance),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class CrossCheckMonitor(BaseMonitor):
    """A cross-check of some channels.

    Attributes
    ----------
    suspects : tuple of str
        The sensors that it may name.

    Examples
    --------
    >>> import gtmbench as gb
    >>> truth = gb.fly("gtm", "doublets", 60.0, seed=1)
    >>> gb.CrossCheck().calibrate([gb.measure(truth, noise="t2")]).suspects  # no magnetometer, no GPS
    ('tas', 'accelerometers', 'alpha', 'beta', 'altitude')
    """

    name: str
    channels: tuple[str, ...]
    sample_period_s: float
    suspects: tuple[str, ...] = ()
    provenance: Mapping[str, object] = field(default_factory=dict)

    @property
    def basis(self) -> Basis:
        """What it rests on: the whole log, its gyros and its attitude."""
        return _BASIS

    @gated
    def watch(self, record: Record) -> Watch:
        """Return the alarms on a record.

        Raises
        ------
        InputError
            If the record lacks a channel or has another sample period.
        """
        stream = self.stream()
        if len(record):
            stream.push(record)
        return Watch(monitor=self, record=record, alarms=stream.alarms)

    def stream(self) -> CrossCheckStream:
        """Return a fresh stream."""
        return CrossCheckStream(self)

    def figures(self) -> dict[str, object]:
        """Return its channels and their period."""
        return {"sample_period_s": self.sample_period_s, "channels": list(self.channels)}


class CrossCheckStream:
    """A cross-check at work: the last two minutes are judged every ten seconds."""

    def __init__(self, monitor: CrossCheckMonitor) -> None:
        self._monitor = monitor
        self._buffer = RollingBuffer(monitor.channels, _PAST_S)
        self._alarms: tuple[Alarm, ...] = ()
        self._accused_s: dict[str, float] = {}  # when each was accused last: what began before is the same failure

    @property
    def armed(self) -> Mapping[str, bool]:
        """That it can alarm: it shows no score."""
        return MappingProxyType({self._monitor.name: True})

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """Every alarm so far."""
        return self._alarms

    def push(self, chunk: Record) -> tuple[Alarm, ...]:
        """Return the alarms that a chunk's samples raise.

        InputError if the chunk doesn't continue the one before, lacks a channel or has another sample period.
        """
        monitor = self._monitor
        chunk.columns(monitor.channels)
        chunk.check_period(monitor.sample_period_s, f"'{monitor.name}' was calibrated at")
        clock, record = self._buffer.joined(chunk)
        before = len(self._alarms)
        every, past, least = (round(each_s / clock.sample_period_s) for each_s in (_LOOK_S, _PAST_S, _LEAST_S))
        first = clock.count - len(record)  # which sample of the stream the buffer begins with
        for count in range((clock.count - len(chunk)) // every * every + every, clock.count + 1, every):
            if count >= least:
                self._look(record.part(range(max(count - first - past, 0), count - first)))
        self._buffer.keep(clock, record)
        return self._alarms[before:]

    def _look(self, past: Record) -> None:
        now_s = past.end_s
        for sensor, span in _accused(past):
            names, judgement = span.suspects or (sensor,), span.judgement
            is_new = all(span.start_s > self._accused_s.get(name, -np.inf) for name in names)
            self._accused_s |= dict.fromkeys(names, now_s)
            if is_new and judgement is not None:
                alarm = Alarm(
                    number=len(self._alarms),
                    time_s=now_s,
                    onset_s=span.start_s,
                    source=self._monitor.name,
                    judgements=(replace(judgement, time_s=now_s),),
                )
                self._alarms += (alarm,)


def _accused(past: Record) -> Iterator[Claim]:
    """Give whom the engine accuses in a record, where no gyro and no angle failed."""
    samples = dict(_samples(past))
    if {*_SIX} <= samples.keys():
        flight = flight_of(samples, is_driven=True, is_assumed=True)
        others = {name: each for name, each in samples.items() if name not in _SIX}
        found = course_judged(flight, others)
        if found.accused or found.standing:  # only then is it worth the time to ask for gyros and attitude
            found = course_beside(judged(flight), others)
        yield from (*found.standing, *found.accused)


def _samples(past: Record) -> Iterator[tuple[str, Samples]]:
    """Give what each channel read: rows between two readings of a slower sensor are missing."""
    for name in past.channels:
        there = np.isfinite(past[name])
        if np.count_nonzero(there) >= _FEWEST:
            yield name, Samples(past.time_s[there], past[name][there])
