"""Which is wrong, a gyro or its angle, by the sensors of a log that no gyro drives.

An estimator's attitude follows its gyros, so what they differ by tells no side. A magnetometer that is read raw is
driven by no gyro in flight (before take-off, PX4 takes a constant off by means of the gyros), and knows r;
accelerometers know p and q, and r where a GPS tells how the aircraft accelerates. They are asked after the fact, about
all of the time in which gyro and angle differ, and only about that: they raise no alarm, and withdraw no name.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Protocol

import numpy as np

from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.intake.magnetometers import FieldReadings
from gtmbench.method.heading_witness import MAGNETOMETER_ITSELF, SHORTEST_S, FieldOpinion, HeadingWitness
from gtmbench.study.log.seconds import SECOND_S
from gtmbench.study.log.slow_means import SLOW, SlowMeans
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import Record, Span

R, PSI = "r", "psi"
BOUND_S = 30.0  # the stretch for which a witness states how well it knows a gyro
FORCES = "accelerometers"  # the name of what knows p and q
_LONGEST_S = 60.0  # of a stretch that is asked about: in more time the aircraft turns too far
_LEAST_DEG_S = 1.0  # a smaller error of a gyro may be warming, a new calibration, or iron that isn't known
_KNOWN = 0.5  # of the seconds in which r and the heading's rate are compared


class Witness(Protocol):
    """A sensor of a log, or several, that is asked which of a gyro and its angle is wrong."""

    @property
    def name(self) -> str:
        """What the log calls it."""

    @property
    def columns(self) -> tuple[str, ...]:
        """The log's columns that it reads."""

    @property
    def records(self) -> tuple[Record, ...]:
        """The log's segments with its channels."""

    @property
    def bounds_deg_s(self) -> Mapping[str, float]:
        """How well it knows each gyro over `BOUND_S`, in deg/s; NaN where too little is healthy."""

    @property
    def least_deg_s(self) -> float:
        """The smallest error for which it names a gyro, in deg/s: a smaller one may be warming."""

    def knows(self, gyro: str) -> bool:
        """Tell whether it can be asked about a gyro."""

    def judge(self, record: Record, gyro: str, span: Span, error_deg_s: float) -> FieldOpinion:
        """Say which is wrong in a span of one of its records, where a gyro reads so much more than its angle turns."""


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

    @property
    def bounds_deg_s(self) -> Mapping[str, float]:
        """The same, by gyro."""
        return {R: self.bound_deg_s}

    @property
    def least_deg_s(self) -> float:
        """The smallest error for which it names r, in deg/s."""
        return _LEAST_DEG_S

    def knows(self, gyro: str) -> bool:
        """Tell whether it can be asked about a gyro."""
        return gyro == R

    def judge(self, record: Record, gyro: str, span: Span, error_deg_s: float) -> FieldOpinion:
        """Say which is wrong, r or the heading."""
        assert gyro == R
        return self.learnt.judge(record, *span, error_deg_s=error_deg_s)


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


def settled(alarm: Alarm, witnesses: Sequence[Witness], means: SlowMeans | None) -> Alarm:
    """Return an alarm that leaves a gyro or its angle open with what witnesses say of it; any other as it is.

    All of them are asked about each part of the time. The gyro is named where one accuses it and none measures another
    error of it, even one that itself can't tell. psi is named where it was either of r and psi; where that is in doubt,
    the doubt stays and says that the heading wanders.

    Parameters
    ----------
    alarm : Alarm
    witnesses : sequence of Witness
    means : SlowMeans or None
        What each gyro reads more than the attitude turns, second by second.
    """
    gyro = open_gyro(alarm)
    if means is None or gyro is None:
        return alarm
    known = [witness for witness in witnesses if witness.knows(gyro)]
    asked, said = [], set()
    for at_least_s in (0.0, BOUND_S) if alarm.test == SLOW else (0.0,):  # a slow fault began before its mean rose
        asked = [opinion for witness in known for opinion in _opinions(alarm, gyro, witness, means, at_least_s)]
        said = {opinion.sensor for _, opinion, _ in asked} - {None}
        if said:
            break
    if not said:
        return _open(alarm, asked)
    first = next(each for each in asked if each[1].sensor is not None)
    if len(said) > 1 or any(_contradict(first, other) for other in asked):
        return _with(alarm, asked[-1][2], _text(asked), doubt=f"{_names(asked)} contradict each other about {gyro}")
    name, opinion, until_s = first
    witness = f"{name}: {opinion.reason}"
    least_deg_s = next(each.least_deg_s for each in known if each.name == name)
    if opinion.sensor == gyro and abs(opinion.error_deg_s) >= least_deg_s:
        return _with(alarm, until_s, witness, sensor=gyro, candidates=(gyro,), doubt="", reason="")
    if opinion.sensor == PSI and not alarm.doubt:
        return _with(alarm, until_s, witness, sensor=PSI, candidates=(PSI,), doubt="", reason="")
    if opinion.sensor == PSI:
        return _with(alarm, until_s, witness, candidates=(PSI,), doubt="the heading wanders")
    if opinion.sensor == MAGNETOMETER_ITSELF:
        return _with(alarm, until_s, witness, doubt=f"{name} is disturbed, which may turn the heading")
    return _open(alarm, asked)


_Said = tuple[str, FieldOpinion, float]  # who said it, what, and when that could be known


def open_gyro(alarm: Alarm) -> str | None:
    """Return the gyro that is wrong, or its angle, by what is known, or may be by means that can tell no more."""
    last = alarm.last
    if last is None or last.sensor is not None or not (alarm.test == SLOW or not last.doubt):
        return None
    pairs = zip(GYROS, ATTITUDE, strict=True)
    candidates = {*last.candidates}
    return next((gyro for gyro, angle in pairs if gyro in candidates <= {gyro, angle}), None)


def _opinions(alarm: Alarm, gyro: str, witness: Witness, means: SlowMeans, at_least_s: float) -> Iterator[_Said]:
    """Give what a witness says of each part of the time in which a gyro and its angle differ, or of so many seconds."""
    until_s = np.inf if alarm.ended_s is None else alarm.ended_s
    for record in witness.records:
        stop_s = min(record.end_s, until_s)
        start_s = max(record.start_s, min(alarm.onset_s, stop_s - at_least_s))
        if stop_s - start_s < SHORTEST_S + record.sample_period_s:
            continue
        edges = np.linspace(start_s, stop_s, int(np.ceil((stop_s - start_s) / _LONGEST_S)) + 1)
        for span in pairwise(edges.tolist()):
            claimed = claimed_deg_s(means, GYROS.index(gyro), span)
            if np.isfinite(claimed):
                yield witness.name, witness.judge(record, gyro, span, claimed), span[1]


def claimed_deg_s(means: SlowMeans, axis: int, span: Span) -> float:
    """Return what a gyro reads more than the attitude turns, in deg/s; NaN where too little of it is known."""
    first, stop = (round((time_s - means.start_s) / SECOND_S) for time_s in span)
    part = means.error[max(first, 0) : stop, axis]
    known = part[np.isfinite(part)]
    return float(known.mean()) if len(known) > _KNOWN * max(len(part), 1) else np.nan


def _names(asked: Sequence[_Said]) -> str:
    """Return who was asked; magnetometers together."""
    names = dict.fromkeys(name if name == FORCES else "magnetometers" for name, _, _ in asked)
    return " and ".join(names)


def _contradict(one: _Said, other: _Said) -> bool:
    """Tell whether two measure different errors of r in the same time, also where one of them accuses nobody."""
    if one[2] != other[2]:
        return False
    apart = abs(one[1].error_deg_s - other[1].error_deg_s)
    return bool(apart > one[1].bound_deg_s + other[1].bound_deg_s)  # not where one doesn't know


def _open(alarm: Alarm, asked: Sequence[_Said]) -> Alarm:
    """Return an alarm that stays open, with why the witnesses can't tell."""
    return _with(alarm, asked[-1][2], _text(asked)) if asked else alarm


def _text(asked: Sequence[_Said]) -> str:
    """Return who said what, each once."""
    return "; ".join(dict.fromkeys(f"{name}: {opinion.reason}" for name, opinion, _ in asked if opinion.reason))


def _with(alarm: Alarm, known_s: float, witness: str, **changed: Any) -> Alarm:
    """Return an alarm with one judgement more: as the last, but for what a witness changes."""
    last = alarm.judgements[-1]
    judged: Judgement = replace(last, time_s=max(last.time_s, known_s), witness=witness, **changed)
    return replace(alarm, judgements=(*alarm.judgements, judged))
