"""The self-check of a log: its channels live, gyros and attitude tell of one motion, every residual explains its own.

Where identified, whatever is wrong stops the watch. Where watched, only a cause that holds for all of it does: what
comes in half-way is what a monitor is for.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gtmbench.detectors.assumptions import basis_of
from gtmbench.detectors.excursion import MOTION, Excursion
from gtmbench.detectors.predicting import predicts
from gtmbench.detectors.protocol import Detector, Monitor, Watch
from gtmbench.intake.flight_log import FlightLog, Remark, Source
from gtmbench.log.self_check.causes import (
    WiringChange,
    WiringGuess,
    as_it_is,
    causes_among,
    guesses,
    is_doubtful,
    other_scales,
    small_lags_s,
)
from gtmbench.log.self_check.explained_motion import (
    ExplainedMotion,
    explained_where_identified,
    explained_where_watched,
)
from gtmbench.log.self_check.words import cause_text, fits_text, mapping_for, nothing_found_text
from gtmbench.values.channels import COMMANDS, axis_of
from gtmbench.values.pieces import pieces
from gtmbench.values.record import FloatArray, Record, Span

IDENTIFIED, WATCHED, ALL = "in the part to learn from", "in the part watched", "in all of it"
_STILL = 1e-9  # of a channel's unit: it doesn't move
_COUNT = ("constant", "saturated")  # remarks that count
_R = "r"
_OTHER_MOTION = "gyros and attitude don't show one motion"


@dataclass(frozen=True, kw_only=True)
class Cause:
    """Why a log isn't what a monitor expects."""

    log: str  # its name
    changes: tuple[WiringChange, ...]  # what has to be undone
    text: str
    why: str  # how much of the motion the attitude explains with that undone, and as it is
    to_type: str  # the options under which the log reads as it should; "" where there are none


@dataclass(frozen=True, kw_only=True)
class Stop:
    """Why nothing is watched: what is wrong, and in which log and part of it, "" where that is said.

    `is_motion`: gyros and attitude don't show one motion, and no cause was found. `sensors`: of which it is said; none
    where it is of all.

    >>> str(Stop(text="q reads 0 all the time: dead, or held", at="flight.csv, in the part watched"))
    'flight.csv, in the part watched: q reads 0 all the time: dead, or held'
    """

    text: str
    at: str = ""
    is_motion: bool = False
    sensors: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.at}: {self.text}" if self.at else self.text


@dataclass(frozen=True, kw_only=True)
class Doubt:
    """Why silence says nothing of some sensors; of all sensors where none is named.

    `is_learnt`: only of what is learnt from a part of the log; what is judged by all of it isn't in doubt.

    >>> str(Doubt(text="p moves too little to show what it is", sensors=("p",)))
    'p moves too little to show what it is'
    """

    text: str
    sensors: tuple[str, ...] = ()
    is_learnt: bool = False

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, kw_only=True)
class SelfCheck:
    """What the self-check found."""

    causes: tuple[Cause, ...] = ()  # of a log that isn't what was expected; two of one log are either-or
    explained: tuple[ExplainedMotion, ...] = ()
    stops: tuple[Stop, ...] = ()  # why nothing is watched
    doubts: tuple[Doubt, ...] = ()  # why silence says nothing, where something was watched
    notes: tuple[str, ...] = ()  # what isn't checked

    @property
    def passed(self) -> bool:
        """Whether the log is what the monitor expects, as far as was checked."""
        return not self.stops and not self.doubts

    @property
    def of_heading(self) -> str:
        """Why it stops, where that may be the heading's alone; "" where it isn't, or doesn't stop."""
        if self.causes or len(self.stops) != 1:
            return ""
        blind = [each for each in self.explained if each.is_blind]
        if [each.output for each in blind] == [_R]:
            return unexplained_text(blind[0])
        return _OTHER_MOTION if self.stops[0].is_motion else ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """Records of a log, where they lie in it, and what they hold of gyros and a whole attitude."""

    log: FlightLog
    records: Sequence[Record]  # with the detector's channels
    spans: Sequence[Span]
    # with p, q, r, phi, theta, psi; none where the log hasn't all of them, or nothing rests on them
    motion: Sequence[Record] = ()
    sources: tuple[Source, ...] = ()  # which columns these are


def check_wiring(watcher: Detector | Monitor, parts: Sequence[Part], where: str) -> SelfCheck:
    """Check the channels that a detector reads, before anything is made of them."""
    causes: list[Cause] = []
    stops: list[Stop] = []
    doubts: list[Doubt] = []
    for part in parts:
        sensors = [channel for channel in watcher.channels if channel not in COMMANDS]  # a command may stand still
        at, dead = f"{part.log.path.name}, {where}", _dead(part.records, sensors)
        wrong = [
            Stop(text=f"{channel} reads {value:.6g} all the time: dead, or held", at=at, sensors=axis_of(channel))
            for channel, value in dead.items()
        ]
        if where == IDENTIFIED:
            counted = [each for each in counting(part.log, part.spans, watcher.channels) if each.channel not in dead]
            wrong += [Stop(text=each.text, at=at, sensors=_sensors_of(each)) for each in counted]
        motion = _still(part.motion, dead)
        tried = guesses(motion)
        found = [guess for guess in causes_among(tried, motion) if _concerns(watcher, guess)]
        named = [_cause(part, guess) for guess in found]
        if named:
            wrong.append(Stop(text=f"{_either(named)}; {named[0].why}", at=at))
        stops += wrong
        if not named and where == IDENTIFIED and is_doubtful(tried, basis_of(watcher).kinematic):
            stops.append(Stop(text=f"{_OTHER_MOTION}; {nothing_found_text()}", at=at, is_motion=True))
        elif not named and where == IDENTIFIED:
            asked = {"", *basis_of(watcher).kinematic}
            doubts += [
                _doubt(scale_text(name, gain), name) for name, gain in other_scales(tried).items() if name in asked
            ]
            doubts += [
                replace(_doubt(lag_text(name, late), name), is_learnt=not name)
                for name, late in small_lags_s(tried).items()
                if name in asked
            ]
        causes += named
    notes = () if all(part.motion for part in parts) else _notes(watcher)
    return SelfCheck(causes=tuple(causes), stops=tuple(stops), doubts=tuple(dict.fromkeys(doubts)), notes=notes)


def _sensors_of(remark: Remark) -> tuple[str, ...]:
    return () if remark.channel is None else axis_of(remark.channel)


def _doubt(text: str, output: str) -> Doubt:
    """Return a doubt of what predicts a sensor: of it, and of the angle that it turns; of all where none is named."""
    return Doubt(text=text, sensors=axis_of(output) if output else ())


def scale_text(gyro: str, gain: tuple[float, float]) -> str:
    """Say that a gyro turns less, or more, than its attitude.

    >>> scale_text("p", (0.68, 0.7))
    'p turns 0.69 times as far as the attitude: a wrong scale, of it or of the attitude, would be learnt as healthy'
    """
    return (
        f"{gyro} turns {0.5 * sum(gain):.2g} times as far as the attitude: a wrong scale, of it or of the attitude, "
        "would be learnt as healthy"
    )


def lag_text(gyro: str, late_s: float) -> str:
    """Say that the attitude is late against a gyro, or against all of them, or they against it.

    >>> lag_text("p", -0.08)
    'p is 0.08 s late against the attitude, which would be learnt as healthy'
    """
    late, other = ("the attitude", gyro or "the gyros")
    if late_s < 0.0:
        late, other = other, late
    are = "are" if late == "the gyros" else "is"
    return f"{late} {are} {abs(late_s):.2f} s late against {other}, which would be learnt as healthy"


def wrong_wiring(monitor: Monitor, motion: Record) -> str:
    """Say what is wrong with how gyros and attitude are read, as far as a stretch of them shows; "" if nothing."""
    tried = guesses([motion])
    found = [guess for guess in causes_among(tried, [motion]) if _concerns(monitor, guess)]
    return " or ".join(cause_text(guess.changes) for guess in found)


def _cause(part: Part, guess: WiringGuess) -> Cause:
    sources = {source.channel: source for source in part.sources}
    return Cause(
        log=part.log.path.name,
        changes=guess.changes,
        text=cause_text(guess.changes),
        why=_better(part, guess),
        to_type=mapping_for(guess, sources),
    )


def _better(part: Part, guess: WiringGuess) -> str:
    now = as_it_is(part.motion)
    said = f"with that undone, the attitude explains {fits_text(guess.fits)} of the motion"
    return said if now is None else f"{said}; as it is, {fits_text(now.fits)}"


def check_identified(check: SelfCheck, monitor: Monitor, records: Sequence[Record]) -> SelfCheck:
    """Return a check with what a monitor's residuals explain where it was identified."""
    if not predicts(monitor) or not records:
        return check
    explained = explained_where_identified(monitor, records)
    blind = [Stop(text=unexplained_text(each), sensors=axis_of(each.output)) for each in explained if each.is_blind]
    if blind:
        blind[-1] = replace(blind[-1], text=f"{blind[-1].text}; {nothing_found_text()}")
    stops = (*check.stops, *blind)
    return replace(check, explained=tuple(explained), stops=stops)


def check_watched(
    check: SelfCheck,
    monitor: Monitor,
    watches: Sequence[Watch],
    log: FlightLog,
    spans: Sequence[Span],
    excursions: Sequence[Excursion],
    accused: Collection[str] = (),
) -> SelfCheck:
    """Return a check with what the residuals explain where watched, and the channels that stand still there.

    What an impact leaves unexplained says nothing of the flight before and after it.

    `spans`: what isn't learnt from. `accused`: the sensors that the engine accuses.
    """
    alarms = [alarm for watch in watches for alarm in watch.faults if not alarm.has_passed]
    told = {*accused, *(name for alarm in alarms for name in (alarm.source, *alarm.candidates))}
    silent = [each for each in counting(log, spans, monitor.channels) if each.channel not in told]
    doubts = (
        *check.doubts,
        *(_doubt(f"{each.text}; no alarm was raised by it", each.channel or "") for each in silent),
    )
    if not predicts(monitor):
        return replace(check, doubts=doubts)
    identified = {each.output: each for each in check.explained}
    untold = [
        (each.start_s, each.end_s)
        for each in excursions
        if each.reason != MOTION and (each.is_hard or not each.is_judged)
    ]
    explained = explained_where_watched(monitor, watches, untold)
    for whole in explained:
        if whole.is_blind and whole.output not in told:
            doubts += (_doubt(unexplained_text(whole), whole.output),)
        elif whole.output in identified and not (whole.is_shown or identified[whole.output].is_shown):
            why = f"{whole.output} moves too little, beside its noise, to show that it is what it is taken for"
            doubts += (replace(_doubt(why, whole.output), is_learnt=True),)
    return replace(check, explained=(*check.explained, *explained), doubts=doubts)


def unexplained_text(each: ExplainedMotion) -> str:
    """Say how little of a sensor's motion is explained."""
    share = 100.0 * max(each.share, 0.0) if np.isfinite(each.share) else 0.0
    return (
        f"in the part {each.where}, {share:.0f} % of {each.output}'s slow motion is explained "
        f"(residual {each.residual:.3g}, signal {each.signal:.3g} RMS): what isn't explained can't be watched"
    )


def _either(causes: Sequence[Cause]) -> str:
    said = [each.text + (f" (then type {each.to_type})" if each.to_type else "") for each in causes]
    return f"either {said[0]}, or {said[1]}, which is the same motion" if len(said) > 1 else said[0]


def counting(log: FlightLog, spans: Sequence[Span], channels: Sequence[str]) -> list[Remark]:
    """Return the remarks on a detector's channels that count in the verdict: what stands still, or at a limit."""
    return [
        remark
        for remark in log.remarks
        if remark.kind in _COUNT
        and remark.channel in (*channels, None)
        and any(remark.start_s <= end_s and remark.end_s >= start_s for start_s, end_s in spans)
    ]


def _dead(records: Sequence[Record], channels: Sequence[str]) -> dict[str, float]:
    """Return the channels that never move, with what they read."""
    dead = {}
    for channel in channels if records else ():
        value = _held_at([record[channel] for record in records])
        if value is not None:
            dead[channel] = value
    return dead


def _held_at(columns: Sequence[FloatArray]) -> float | None:
    """Return the first value of columns that never move from it; None where they do, or have none."""
    value, low, high = None, np.inf, -np.inf
    for part in (column[rows] for column in columns for rows in pieces(len(column))):
        there = part[np.isfinite(part)]
        if len(there):
            value = float(there[0]) if value is None else value
            low, high = min(low, float(there.min())), max(high, float(there.max()))
            if high - low > _STILL * max(1.0, abs(value)):
                return None
    return value


def _still(records: Sequence[Record], dead: Mapping[str, float]) -> list[Record]:
    """Return records whose dead channels read exactly one value."""
    still = []
    for record in records:
        for channel in dead.keys() & set(record.channels):
            record = record.replace(channel, np.full(len(record), dead[channel]))
        still.append(record)
    return still


def _concerns(watcher: Detector | Monitor, guess: WiringGuess) -> bool:
    """Tell whether a guess changes a channel that a detector reads, or the time."""
    touched = {name for change in guess.changes for name in change.channels}
    return bool(touched & {*watcher.channels, "time"})


def rests_on_motion(watcher: Detector | Monitor) -> bool:
    """Tell whether a detector compares sensors with what kinematics say that they read."""
    return bool(basis_of(watcher).kinematic)


def _notes(watcher: Detector | Monitor) -> tuple[str, ...]:
    """Say what isn't checked."""
    asked = basis_of(watcher).kinematic
    why = "the log has no whole attitude" if asked else "nothing says what its sensors should read"
    what = f"that channels live and that of {', '.join(asked)} motion is explained" if asked else "that channels live"
    return (f"self-check: {what}, no more, for {why}: signs, units, axes, lags and the time base weren't tried",)
