"""The self-check of a log: its channels live, gyros and attitude tell of one motion, every residual explains its own.

Where identified, whatever is wrong stops the watch. Where watched, only a cause that holds for all of it does: what
comes in half-way is what a monitor is for.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gtmbench.detectors.bank.bank import Bank
from gtmbench.detectors.bank.calibrated import CalibratedBank
from gtmbench.detectors.bank_detector import BankDetector
from gtmbench.detectors.protocol import Detector, Monitor, Watch
from gtmbench.intake.flight_log import FlightLog, Remark
from gtmbench.method.estimators.bayesian import reproduces
from gtmbench.record import Record, Span
from gtmbench.study.log.self_check.causes import Change, as_it_is, cause_of
from gtmbench.study.log.self_check.explained import (
    Explained,
    explained_where_identified,
    explained_where_watched,
)
from gtmbench.study.log.self_check.motion import ANGLES, GYROS
from gtmbench.study.log.self_check.told import cause_text, fits_text, mapping_for, tried_text

IDENTIFIED, WATCHED, ALL = "where identified", "where watched", "in all of it"
_STILL = 1e-9  # of a channel's unit: it doesn't move
_COUNT = ("constant", "saturated")  # remarks that count


@dataclass(frozen=True, kw_only=True)
class Cause:
    """Why a log isn't what a monitor expects.

    Attributes
    ----------
    log : str
        Its name.
    changes : tuple of Change
        What has to be undone.
    text : str
    to_type : str
        The options under which the log reads as it should; "" where there are none.
    """

    log: str
    changes: tuple[Change, ...]
    text: str
    to_type: str


@dataclass(frozen=True, kw_only=True)
class SelfCheck:
    """What the self-check found.

    Attributes
    ----------
    causes : tuple of Cause
        Of a log that isn't what was expected; two of one log are either-or.
    explained : tuple of Explained
    stops : tuple of str
        Why nothing is watched.
    doubts : tuple of str
        Why silence says nothing, where something was watched.
    notes : tuple of str
        What isn't checked.
    """

    causes: tuple[Cause, ...] = ()
    explained: tuple[Explained, ...] = ()
    stops: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether the log is what the monitor expects, as far as was checked."""
        return not self.stops and not self.doubts


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """Records of a log, and where they lie in it."""

    log: FlightLog
    records: Sequence[Record]
    spans: Sequence[Span]


def check_wiring(watcher: Detector | Monitor, parts: Iterable[Part], where: str) -> SelfCheck:
    """Check the channels that a detector reads, before anything is made of them.

    Parameters
    ----------
    watcher : Detector or Monitor
    parts : iterable of Part
        One a log.
    where : str
        What they are: ``where identified``, ``where watched``.
    """
    causes: list[Cause] = []
    stops: list[str] = []
    is_identified = where == IDENTIFIED
    for part in parts:
        at = f"{part.log.path.name}, {where}"
        dead = _dead(part.records, watcher.channels)
        stops += [f"{at}: {channel} reads {value:.6g} all the time: dead, or held" for channel, value in dead]
        if is_identified:
            stops += [
                f"{at}: {each.text}" for each in counting(part, watcher.channels) if each.channel not in dict(dead)
            ]
        if not is_kinematic(watcher):
            continue
        found = cause_of([_alive(record, dict(dead)) for record in part.records])
        sources = {source.channel: source for source in part.log.sources}
        named = [
            Cause(
                log=part.log.path.name,
                changes=guess.changes,
                text=cause_text(guess.changes),
                to_type=mapping_for(guess, sources),
            )
            for guess in found
        ]
        if named:
            now = as_it_is(part.records)
            better = f"undone, the attitude explains {fits_text(found[0].fits)} of the motion"
            stops.append(f"{at}: {_either(named)}; {better}, as it is {fits_text(now.fits if now else {})}")
        causes += named
    return SelfCheck(causes=tuple(causes), stops=tuple(stops), notes=_notes(watcher))


def check_identified(check: SelfCheck, monitor: Monitor, records: Sequence[Record]) -> SelfCheck:
    """Return a check with what a monitor's residuals explain where it was identified."""
    if not isinstance(monitor, CalibratedBank) or not records:
        return check
    explained = explained_where_identified(monitor, records)
    stops = [unexplained_text(each) for each in explained if each.is_blind]
    if stops:
        stops[-1] += f"; no cause was found that makes every gyro fit ({tried_text()})"
    return replace(check, explained=tuple(explained), stops=(*check.stops, *stops))


def check_watched(check: SelfCheck, monitor: Monitor, watches: Sequence[Watch], part: Part) -> SelfCheck:
    """Return a check with what the residuals explain where watched, and the channels that stand still there."""
    doubts = (*check.doubts, *(f"{each.text}; no alarm tells of it" for each in counting(part, monitor.channels)))
    if not isinstance(monitor, CalibratedBank):
        return replace(check, doubts=doubts)
    before = {each.output: each for each in check.explained}
    explained = explained_where_watched(monitor, watches)
    told = {alarm.source for watch in watches for alarm in watch.faults if not alarm.has_passed}
    for each in explained:
        if each.is_blind and each.output not in told:
            doubts += (unexplained_text(each),)
        elif each.output in before and not (each.is_shown or before[each.output].is_shown):
            doubts += (f"{each.output} hardly moves: nothing shows that it is what it is taken for",)
    return replace(check, explained=(*check.explained, *explained), doubts=doubts)


def unexplained_text(each: Explained) -> str:
    """Say how little of a sensor's motion is explained."""
    share = 100.0 * max(each.share, 0.0) if np.isfinite(each.share) else 0.0
    return (
        f"where {each.where}, {share:.0f} % of {each.output}'s slow motion is explained (residual {each.residual:.3g}, "
        f"signal {each.signal:.3g} RMS): what isn't explained isn't watched"
    )


def _either(causes: Sequence[Cause]) -> str:
    said = [each.text + (f" (then type {each.to_type})" if each.to_type else "") for each in causes]
    return f"either {said[0]}, or {said[1]}, which is the same motion" if len(said) > 1 else said[0]


def counting(part: Part, channels: Sequence[str]) -> list[Remark]:
    """Return the remarks on a detector's channels that count in the verdict: what stands still, or at a limit."""
    return [
        remark
        for remark in part.log.remarks
        if remark.kind in _COUNT
        and remark.channel in (*channels, None)
        and any(remark.start_s <= end_s and remark.end_s >= start_s for start_s, end_s in part.spans)
    ]


def _dead(records: Sequence[Record], channels: Sequence[str]) -> list[tuple[str, float]]:
    """Return the channels that never move, with what they read."""
    dead = []
    for channel in channels if records else ():
        values = np.concatenate([record[channel] for record in records])
        values = values[np.isfinite(values)]
        if len(values) and np.ptp(values) <= _STILL * max(1.0, abs(float(values[0]))):
            dead.append((channel, float(values[0])))
    return dead


def _alive(record: Record, dead: Mapping[str, float]) -> Record:
    """Return a record whose dead channels read exactly one value."""
    for channel, value in dead.items():
        record = record.replace(channel, np.full(len(record), value))
    return record


def bank_in(watcher: Detector | Monitor) -> Bank | None:
    """Return a detector's bank, if it is one."""
    return watcher.bank if isinstance(watcher, (BankDetector, CalibratedBank)) else None


def is_kinematic(watcher: Detector | Monitor) -> bool:
    """Tell whether a detector rests on kinematics of gyros and attitude, all of which its records have."""
    bank = bank_in(watcher)
    return bank is not None and set(GYROS) | set(ANGLES) <= set(bank.channels)


def _notes(watcher: Detector | Monitor) -> tuple[str, ...]:
    """Say what isn't checked."""
    if is_kinematic(watcher):
        return ()
    bank = bank_in(watcher)
    asked = (
        []
        if bank is None
        else [spec.output for spec in bank.residuals if any(reproduces(name, spec.output) for name in spec.inputs)]
    )
    what = f"that {', '.join(asked)} are explained" if asked else "that channels live"
    return (
        f"self-check: {what}, no more; signs, units, axes, lags and the time base are tried where gyros and a whole "
        "attitude are read (bank C)",
    )
