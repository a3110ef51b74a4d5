"""The cross-check as a detector: it learns relations on healthy records, and watches all that a record holds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from gtmbench.checks import number
from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.detectors.base import BaseMonitor
from gtmbench.detectors.crosscheck.learnt import Learnt
from gtmbench.detectors.crosscheck.naming import NAMED, Seen, axis_of, candidates, text
from gtmbench.detectors.crosscheck.own import OwnNoise, own_ratios
from gtmbench.detectors.crosscheck.relations import (
    BLOCK_S,
    CHANNELS,
    Motion,
    Relation,
    gps_delay_s,
    relations,
)
from gtmbench.detectors.gate import gated
from gtmbench.detectors.protocol import Score, Watch
from gtmbench.detectors.tables import PERIODS_S, keys
from gtmbench.errors import InputError
from gtmbench.files.plain import exact, finite_or_none
from gtmbench.jobs.progress import Progress, silent
from gtmbench.method.problem import taught_records
from gtmbench.method.windowed_alarms import came_down
from gtmbench.values.channels import ATTITUDE, GYROS, MAGNETOMETER
from gtmbench.values.record import FloatArray, Record

CROSS_CHECK = "cross-check"
_LOOKS_S = (*range(21), *range(25, 121, 5))  # after an alarm: what drifts is told late
_QUIET_S = 10.0  # below all bounds: it is over
_NEEDED = (*GYROS, *ATTITUDE)
_SURE = 2  # looks more at which the same sensor has to be the only one


@dataclass(frozen=True, kw_only=True)
class CrossCheck:
    """A detector of faults of the sensors that no gyro enters: which of them contradicts the others.

    It uses what a record holds of magnetometer (mag_x, mag_y, mag_z), GPS velocity (gps_north, gps_east, gps_down),
    accelerometers (nx, ny, nz), airspeed (tas, with alpha and beta where they are there) and altitude; and the
    attitude, which gyros may drive. It never names a gyro, an angle of the attitude or the wind: where one of these
    may be wrong, it can't tell.

    Attributes
    ----------
    name : str
    channels : tuple of str
        Empty: it takes what is there. Gyros and attitude have to be.
    by_itself : bool
        Whether a sensor may be found by what it shows itself: that it repeats one reading, falls silent or becomes
        noisy. Of a recorded flight that proves nothing: motors shake its sensors, at 10 Hz a turn changes readings as
        noise does, and an aircraft may hover so still that readings repeat.
    margin : float
        By how much bounds exceed those that the healthy noise tells. Flight after a short healthy part is often
        rougher than that was.

    Examples
    --------
    >>> import gtmbench as gb
    >>> truth = gb.fly("gtm", "doublets", 120.0, seed=1)
    >>> flight = gb.with_gps(gb.measure(truth, noise="t2"), truth, gb.Gps())
    >>> monitor = gb.CrossCheck().calibrate([flight.between(0.0, 80.0)])
    >>> iced = gb.inject(flight, gb.Jam(channel="tas", onset_s=90.0))
    >>> monitor.watch(iced).alarms[0].verdict, monitor.watch(flight).alarms
    ('tas failed', ())
    """

    name: str = CROSS_CHECK
    channels: tuple[str, ...] = ()
    by_itself: bool = True
    margin: float = 1.0

    def calibrate(
        self, records: Sequence[Record], false_alarms_per_hour: float | None = None, *, progress: Progress = silent
    ) -> CrossCheckMonitor:
        """Return a monitor of what healthy records show; its bounds are fixed, and it promises no rate.

        Raises
        ------
        InputError
            If a rate is asked for, a record lacks gyros or attitude, or none of the relations can be learnt.
        """
        if false_alarms_per_hour is not None:
            raise InputError(
                f"'{self.name}' can't promise {false_alarms_per_hour:g} false alarms an hour; leave the rate out"
            )
        healthy = taught_records(records)
        for record in healthy:
            record.columns(_NEEDED)
        progress("learn", 0, 1)
        taken = [name for own in CHANNELS.values() for name in own]
        used = tuple(name for name in (*_NEEDED, *taken) if all(name in each for each in healthy))
        motions = [Motion.of(record.select(used)) for record in healthy]
        delay_s, field_ned = gps_delay_s(max(motions, key=lambda each: each.blocks)), _field_of(motions)
        parts: dict[str, list[Relation]] = {}
        for motion in motions:
            for relation in relations(motion, delay_s, field_ned):
                parts.setdefault(relation.name, []).append(relation)
        learnt = {
            name: each.with_margin(self.margin) for name, own in parts.items() if (each := Learnt.of(own)) is not None
        }
        if not learnt:
            raise InputError(_nothing(used))
        own_names = [name for name in used if name not in ATTITUDE]
        return CrossCheckMonitor(
            name=self.name,
            channels=used,
            sample_period_s=healthy[0].sample_period_s,
            delay_s=delay_s,
            field_ned=field_ned,
            learnt=learnt,
            own={name: OwnNoise.of(healthy, name) for name in own_names},
            entered={axis: tuple(sorted(sensors)) for name in learnt for axis, sensors in parts[name][0].axes},
            suspects=_suspects(used),
            by_itself=self.by_itself,
        )

    def restore(
        self, figures: Mapping[str, Any], provenance: Mapping[str, Any] = MappingProxyType({})
    ) -> CrossCheckMonitor:
        """Return the monitor of some figures."""
        table = keys(
            "figures",
            figures,
            ("sample_period_s", "channels", "delay_s", "field_ned", "learnt", "own", "entered", "by_itself"),
        )
        return CrossCheckMonitor(
            name=self.name,
            channels=tuple(table["channels"]),
            sample_period_s=number("sample_period_s", table["sample_period_s"], *PERIODS_S),
            delay_s=number("delay_s", table["delay_s"], 0.0, 2.0),
            field_ned=None if table["field_ned"] is None else np.asarray(table["field_ned"], dtype=np.float64),
            learnt={name: Learnt.from_table(own) for name, own in table["learnt"].items()},
            own={
                name: OwnNoise(**{key: np.inf if each is None else float(each) for key, each in own.items()})
                for name, own in table["own"].items()
            },
            entered={axis: tuple(sensors) for axis, sensors in table["entered"].items()},
            suspects=_suspects(table["channels"]),
            by_itself=bool(table["by_itself"]),
            provenance=dict(provenance),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class CrossCheckMonitor(BaseMonitor):
    """A cross-check that has learnt on healthy records.

    Attributes
    ----------
    delay_s : float
        How late the GPS is.
    field_ned : array or None
        The Earth's field along north, east and down, roughly, in the magnetometer's unit.
    learnt : mapping of relation to Learnt
    own : mapping of channel to OwnNoise
    entered : mapping of relation to tuple of str
        Which sensors enter each relation, beside the attitude and the wind: what it can isolate, and what it can't.
    suspects : tuple of str
        The sensors that it may name.
    by_itself : bool
        Whether a sensor may be found by what it shows itself.

    Examples
    --------
    >>> import gtmbench as gb
    >>> truth = gb.fly("gtm", "doublets", 60.0, seed=1)
    >>> monitor = gb.CrossCheck().calibrate([gb.measure(truth, noise="t2")])  # no magnetometer, no GPS
    >>> monitor.entered["altitude, accelerometers"], monitor.suspects
    (('accelerometers', 'altitude', 'attitude'), ('accelerometers', 'tas', 'alpha', 'beta', 'altitude'))
    """

    name: str
    channels: tuple[str, ...]
    sample_period_s: float
    delay_s: float
    field_ned: FloatArray | None
    learnt: Mapping[str, Learnt] = field(repr=False)
    own: Mapping[str, OwnNoise] = field(repr=False)
    entered: Mapping[str, tuple[str, ...]] = field(repr=False)
    suspects: tuple[str, ...] = ()
    by_itself: bool = True
    provenance: Mapping[str, object] = field(default_factory=dict)

    @gated
    def watch(self, record: Record) -> Watch:
        """Return the alarms on a record: a relation that is violated, and which sensor that accuses, as time goes on.

        Raises
        ------
        InputError
            If the record lacks a channel or has another sample period.
        """
        record.columns(self.channels)
        record.check_period(self.sample_period_s, f"'{self.name}' was calibrated at")
        record_of_own = record.select(self.channels)
        motion = Motion.of(record_of_own)
        if not motion.blocks:
            return Watch(monitor=self, record=record, alarms=())
        seen = [
            Seen.of(relation, self.learnt[relation.name])
            for relation in relations(motion, self.delay_s, self.field_ned)
            if relation.name in self.learnt
        ]
        own = own_ratios(record_of_own, self.own, motion.blocks) if self.by_itself else {}
        ratios = {axis: each.ratios[:, place] for each in seen for place, (axis, _) in enumerate(each.relation.axes)}
        ratios |= {f"{sensor} by itself": each for sensor, each in own.items()}
        ends = slice(motion.rows - 1, motion.blocks * motion.rows, motion.rows)
        return Watch(
            monitor=self,
            record=record,
            scores=MappingProxyType({name: _score(name, each, record, motion.rows) for name, each in ratios.items()}),
            alarms=tuple(_alarms(seen, own, ratios, motion.turns_rad, record.time_s[ends])),
        )

    def figures(self) -> dict[str, object]:
        """Return what was learnt as plain values."""
        return {
            "sample_period_s": self.sample_period_s,
            "channels": list(self.channels),
            "by_itself": self.by_itself,
            "delay_s": self.delay_s,
            "field_ned": None if self.field_ned is None else exact(self.field_ned),
            "learnt": {name: own.table for name, own in self.learnt.items()},
            "entered": exact(self.entered),
            "own": {
                name: {key: finite_or_none(each) for key, each in vars(own).items()} for name, own in self.own.items()
            },
        }


def _score(name: str, ratios: FloatArray, record: Record, rows: int) -> Score:
    """Return a relation's ratios as a score: what a block of so many rows tells holds until the next one ends."""
    values = np.full(len(record), np.nan)
    values[rows - 1 :] = np.repeat(ratios, rows)[: len(record) - rows + 1]
    return Score(name=name, values=values, known_s=record.time_s, armed=came_down(values, 1.0))


def _alarms(
    seen: Sequence[Seen],
    own: Mapping[str, FloatArray],
    ratios: Mapping[str, FloatArray],
    turns_rad: FloatArray,
    known_s: FloatArray,
) -> Iterator[Alarm]:
    """Give an alarm a time in which relations are violated that weren't before, with what is said of it."""
    armed = {name: np.where(came_down(each, 1.0), np.nan_to_num(each), 0.0) for name, each in ratios.items()}
    worst = np.max(list(armed.values()), axis=0)
    block, number = 0, 0
    while (first := _next(worst, block)) is not None:
        quiet = _quiet(worst, first)
        stop = len(worst) if quiet is None else quiet
        yield Alarm(
            number=number,
            time_s=float(known_s[first]),
            onset_s=float(known_s[first]),
            source=max(armed, key=lambda name: float(armed[name][first])),
            judgements=tuple(_judged(seen, own, range(first, stop), turns_rad, known_s)),
            ended_s=None if quiet is None else float(known_s[quiet - round(_QUIET_S / BLOCK_S)]),
            end_known_s=None if quiet is None else float(known_s[quiet]),
        )
        if quiet is None:
            return
        block, number = quiet, number + 1


def _suspects(channels: Sequence[str]) -> tuple[str, ...]:
    """Return the sensors that may be named where some channels are there."""
    return tuple(name for name in NAMED if set(CHANNELS[name]) <= set(channels))


def _next(worst: FloatArray, block: int) -> int | None:
    """Return the first block from some block on with a violated relation."""
    after = np.flatnonzero(worst[block:] > 1.0)
    return block + int(after[0]) if len(after) else None


def _quiet(worst: FloatArray, first: int) -> int | None:
    """Return the block in which nothing has been violated for long enough; None where that never is."""
    calm = round(_QUIET_S / BLOCK_S)
    loud = np.flatnonzero(worst[first:] > 1.0) + first
    for last, then in zip(loud, [*loud[1:], len(worst) + calm], strict=True):
        if then - last > calm and last + calm < len(worst):
            return int(last) + calm
    return None


def _judged(
    seen: Sequence[Seen], own: Mapping[str, FloatArray], blocks: range, turns_rad: FloatArray, known_s: FloatArray
) -> Iterator[Judgement]:
    """Give what is said of an alarm: at once, and whenever that changes, for two minutes."""
    said, same = None, 0
    before: tuple[str, ...] = ()
    for later_s in _LOOKS_S:
        now = blocks.start + round(later_s / BLOCK_S)
        if now >= blocks.stop:
            return
        until = range(blocks.start, now + 1)
        shown = {name: float(np.max(np.nan_to_num(each[until.start : until.stop]))) for name, each in own.items()}
        left = candidates(seen, shown, until, turns_rad)
        same, before = (same + 1 if left == before else 0), left
        sensor = left[0] if len(left) == 1 and left[0] in NAMED and same >= _SURE else None
        told = (left, sensor)
        if told == said:
            continue
        said = told
        is_open = sensor is None and not set(left) <= set(NAMED)
        reason = "" if sensor else text(left)
        yield Judgement(
            time_s=float(known_s[now]),
            sensor=sensor,
            candidates=left,
            axis=axis_of(sensor, seen, until) if sensor else "",
            reason=reason,
            doubt=reason if is_open or not left else "",
        )


def _field_of(motions: Sequence[Motion]) -> FloatArray | None:
    """Return the mean field along north, east and down; None where there is no magnetometer, or it reads nothing."""
    turned = []
    for motion in motions:
        if not set(MAGNETOMETER) <= set(motion.record.channels):
            return None
        raw = motion.record.matrix(MAGNETOMETER)
        read = np.isfinite(raw).all(axis=1) & (motion.known > 0.0)
        turned.append(np.einsum("ijk,kj->ki", motion.turned[:, :, read], raw[read]))
    told = np.concatenate(turned)
    mean = told.mean(axis=0) if len(told) else np.zeros(3)
    return mean if np.linalg.norm(mean) > 0.0 else None


def _nothing(used: Sequence[str]) -> str:
    return (
        f"the cross-check finds no two sensors to compare, or less than some ten healthy seconds of them (found: "
        f"{', '.join(used)}); it compares GPS velocity, accelerometers, tas and altitude with each other, and a "
        "magnetometer with the attitude"
    )
