"""Which is wrong, the yaw gyro or the heading, by the magnetometers of a log.

An estimator's heading follows its yaw gyro, so what they differ by tells no side. A magnetometer that is read raw is
driven by no gyro in flight (before take-off, PX4 takes a constant off by means of the gyros). It is asked after the
fact, about all of the time in which they differ, and only about that: it raises no alarm, and withdraws no name.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.intake.magnetometers import FieldReadings
from gtmbench.method.heading_witness import MAGNETOMETER_ITSELF, SHORTEST_S, FieldOpinion, HeadingWitness
from gtmbench.study.log.seconds import SECOND_S
from gtmbench.study.log.slow_means import SLOW, SlowMeans
from gtmbench.values.record import Record, Span

R, PSI = "r", "psi"
BOUND_S = 30.0  # the stretch for which a witness states how well it knows r
_LONGEST_S = 60.0  # of a stretch that is asked about: in more time the aircraft turns too far
_LEAST_DEG_S = 1.0  # a smaller error of a gyro may be warming, or a new calibration
_KNOWN = 0.5  # of the seconds in which r and the heading's rate are compared


@dataclass(frozen=True, kw_only=True, eq=False)
class FieldWitness:
    """A magnetometer of a log, which knows what is usual.

    Attributes
    ----------
    name : str
        As the log calls it.
    columns : tuple of str
        The log's, along x, y and z.
    records : tuple of Record
        The log's segments with mag_x, mag_y and mag_z.
    learnt : HeadingWitness
    """

    name: str
    columns: tuple[str, str, str]
    records: tuple[Record, ...] = field(repr=False)
    learnt: HeadingWitness = field(repr=False)

    @cached_property
    def bound_deg_s(self) -> float:
        """How well it knows r over `BOUND_S`, in deg/s; NaN where too little is healthy."""
        return self.learnt.bound_deg_s(BOUND_S)


def field_witnesses(
    magnetometers: Sequence[FieldReadings], segments: Sequence[Record], healthy: Sequence[Record]
) -> tuple[FieldWitness, ...]:
    """Return the magnetometers that some healthy seconds teach.

    Parameters
    ----------
    magnetometers : sequence of FieldReadings
    segments, healthy : sequence of Record
        With p, q and r: the log, and what of it is healthy.
    """
    taught = [record for record in healthy if record.end_s - record.start_s > SHORTEST_S]
    if not taught:
        return ()
    return tuple(
        FieldWitness(
            name=each.name,
            columns=each.columns,
            records=tuple(map(each.beside, segments)),
            learnt=HeadingWitness(healthy=tuple(map(each.beside, taught))),
        )
        for each in magnetometers
    )


def settled(alarm: Alarm, witnesses: Sequence[FieldWitness], means: SlowMeans | None) -> Alarm:
    """Return an alarm that leaves r or psi open with what magnetometers say of it; any other as it is.

    All of them are asked about each part of the time. r is named where one accuses it and none measures another error
    of it, even one that itself can't tell. psi is named where it was either of the two; where that is in doubt, the
    doubt stays and says that the heading wanders.

    Parameters
    ----------
    alarm : Alarm
    witnesses : sequence of FieldWitness
    means : SlowMeans or None
        What r reads more than the heading turns, second by second.
    """
    if means is None or not witnesses or not _is_open(alarm):
        return alarm
    asked = [opinion for witness in witnesses for opinion in _opinions(alarm, witness, means)]
    said = {opinion.sensor for _, opinion, _ in asked} - {None}
    if not said:
        return _open(alarm, asked)
    first = next(each for each in asked if each[1].sensor is not None)
    if len(said) > 1 or any(_contradict(first, other) for other in asked):
        return _with(alarm, asked[-1][2], _text(asked), doubt="magnetometers contradict each other about r")
    name, opinion, until_s = first
    witness = f"{name}: {opinion.reason}"
    if opinion.sensor == R and abs(opinion.error_deg_s) >= _LEAST_DEG_S:
        return _with(alarm, until_s, witness, sensor=R, candidates=(R,), doubt="", reason="")
    if opinion.sensor == PSI and not alarm.doubt:
        return _with(alarm, until_s, witness, sensor=PSI, candidates=(PSI,), doubt="", reason="")
    if opinion.sensor == PSI:
        return _with(alarm, until_s, witness, candidates=(PSI,), doubt="the heading wanders")
    if opinion.sensor == MAGNETOMETER_ITSELF:
        return _with(alarm, until_s, witness, doubt=f"{name} is disturbed, which may turn the heading")
    return _open(alarm, asked)


_Said = tuple[str, FieldOpinion, float]  # who said it, what, and when that could be known


def _is_open(alarm: Alarm) -> bool:
    """Tell whether r or psi is wrong, by what is known, or may be, by means that can tell no more."""
    last = alarm.last
    if last is None or last.sensor is not None or R not in last.candidates or not {*last.candidates} <= {R, PSI}:
        return False
    return alarm.test == SLOW or not last.doubt


def _opinions(alarm: Alarm, witness: FieldWitness, means: SlowMeans) -> Iterator[_Said]:
    """Give what a magnetometer says of each part of the time in which r and the heading differ."""
    until_s = np.inf if alarm.ended_s is None else alarm.ended_s
    for record in witness.records:
        start_s, stop_s = max(record.start_s, alarm.onset_s), min(record.end_s, until_s)
        if stop_s - start_s < SHORTEST_S + record.sample_period_s:
            continue
        edges = np.linspace(start_s, stop_s, int(np.ceil((stop_s - start_s) / _LONGEST_S)) + 1)
        for first_s, last_s in pairwise(edges.tolist()):
            claimed = _claimed(means, (first_s, last_s))
            if np.isfinite(claimed):
                yield witness.name, witness.learnt.judge(record, first_s, last_s, error_deg_s=claimed), last_s


def _claimed(means: SlowMeans, span: Span) -> float:
    """Return what r reads more than the heading turns, in deg/s; NaN where too little of it is known."""
    first, stop = (round((time_s - means.start_s) / SECOND_S) for time_s in span)
    part = means.error[max(first, 0) : stop, 2]
    known = part[np.isfinite(part)]
    return float(known.mean()) if len(known) > _KNOWN * max(len(part), 1) else np.nan


def _contradict(one: _Said, other: _Said) -> bool:
    """Tell whether two measure different errors of r in the same time, also where one of them accuses nobody."""
    if one[2] != other[2]:
        return False
    apart = abs(one[1].error_deg_s - other[1].error_deg_s)
    return bool(apart > one[1].bound_deg_s + other[1].bound_deg_s)  # not where one doesn't know


def _open(alarm: Alarm, asked: Sequence[_Said]) -> Alarm:
    """Return an alarm that stays open, with why the magnetometers can't tell."""
    return _with(alarm, asked[-1][2], _text(asked)) if asked else alarm


def _text(asked: Sequence[_Said]) -> str:
    """Return who said what, each once."""
    return "; ".join(dict.fromkeys(f"{name}: {opinion.reason}" for name, opinion, _ in asked if opinion.reason))


def _with(alarm: Alarm, known_s: float, witness: str, **changed: Any) -> Alarm:
    """Return an alarm with one judgement more: as the last, but for what a witness changes."""
    last = alarm.judgements[-1]
    judged: Judgement = replace(last, time_s=max(last.time_s, known_s), witness=witness, **changed)
    return replace(alarm, judgements=(*alarm.judgements, judged))
