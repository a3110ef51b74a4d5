"""What the engine says of a flight: who failed, by its findings; where everybody else is clear, by hindsight."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np

from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.engine.bursts import bursts_of
from gtmbench.engine.curves import ErrorCurve, curves_of
from gtmbench.engine.doubts import BENT_DEG, YAW, with_doubts
from gtmbench.engine.evidence import axis_number
from gtmbench.engine.explanations.angle import STEP
from gtmbench.engine.finding import Finding, Side
from gtmbench.engine.findings import findings_of
from gtmbench.engine.flight import Flight
from gtmbench.engine.hindsight.cleared_sensors import Failure, Hindsight, LevelChange, hindsight_of
from gtmbench.engine.imus.imu import gyro_and_imu
from gtmbench.engine.model import Model
from gtmbench.engine.named import alarm_of, claims_of, judgement_of
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import Span
from gtmbench.verdict.timeline import Claim, SensorSpan, Sizes, State, unjudged

_SPARE = 1.2  # times an error that may be there: what is excluded
_LASTS_S = 10.0  # what passes sooner is a gust, and no error that stays
_LATE_S = 12.0  # before the last that is judged: what lasts ten seconds names somebody by itself
_EARLIER_S = 2.0  # than all onsets that are left: what grows from nothing is dated when it shows
_PARTS_DEG_S, _ALIKE = 2.0, 0.5  # a smaller difference bends no attitude far; of what a finding itself is
_SIGNED = ("size", "slope", "value")  # parameters that a gyro which is mounted the other way round has reversed
_CONSTANT = ("bias", "drift")  # beside which an angle's jump still shows


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """What the engine says of a flight."""

    found: tuple[Finding, ...]  # one each a fault, with doubts
    model: Model = field(repr=False)  # the flight's equations, with everything that was found taken away

    @property
    def flight(self) -> Flight:
        """What is judged."""
        return self.model.flight

    @cached_property
    def accused(self) -> tuple[Claim, ...]:
        """Whom findings accuse: the one sensor that is left, or each of the few that are."""
        logged = dict(_logged(self.flight))
        return tuple(_as_logged(claim, logged) for each in self.found for claim in self._of(each))

    def names(self, sensor: str, start_s: float, end_s: float) -> bool:
        """Tell whether a sensor is said to have failed in some part of a span."""
        own = [span for name, span in self.accused if (name, span.state) == (sensor, State.FAILED)]
        return any(span.meets(start_s, end_s) for span in own)

    def holds(self, sensor: str, start_s: float, end_s: float) -> bool:
        """Tell whether it names whom an alarm accuses over a span, or can't yet.

        What begins so late that the whole log tells nothing of it, and lasts, stands on the alarm alone, unless
        anything was found of others meanwhile.
        """
        if self.names(sensor, start_s, end_s):
            return True
        times_s = self.flight.blocks.time_s[self.flight.judged]
        last_s = float(times_s.max(initial=-np.inf))
        is_late = len(times_s) > 0 and start_s > last_s - _LATE_S and end_s >= last_s
        return is_late and not any(each.end_s > start_s and sensor not in each.suspects for each in self.found)

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """The same as alarms: one each finding that accuses anybody."""
        accusing = [each for each in self.found if each.accuses]
        logged = dict(_logged(self.flight))
        alarms = (alarm_of(each, number, self._span(each)) for number, each in enumerate(accusing))
        return tuple(
            replace(
                alarm,
                source=logged.get(alarm.source, (alarm.source, 1.0))[0],
                judgements=tuple(_named(each, logged) for each in alarm.judgements),
            )
            for alarm in alarms
        )

    def hindsight(self, failures: Mapping[str, Sequence[Failure]]) -> Hindsight:
        """Return where p, q, r, phi, theta and psi are clear, beside all that failed.

        `failures`, by sensor: whom others accuse; the engine's own are added.
        """
        named = {sensor: list(spans) for sensor, spans in failures.items()}
        for sensor, span in self.accused:
            named.setdefault(sensor, []).append(failure_of(span))
        return _hindsight(self.flight, tuple((sensor, tuple(spans)) for sensor, spans in named.items()))

    @cached_property
    def cleared(self) -> Hindsight:
        """Where sensors are clear if nobody else accuses any."""
        return self.hindsight({})

    @cached_property
    def claims(self) -> Mapping[str, tuple[SensorSpan, ...]]:
        """What is claimed of p, q, r, phi, theta and psi where nobody else says anything."""
        cleared = self.beside(self.cleared)
        return {
            sensor: (*spans, *(span for name, span in self.accused if name == sensor))
            for sensor, spans in cleared.items()
        }

    def beside(self, cleared: Hindsight) -> Mapping[str, tuple[SensorSpan, ...]]:
        """Return what hindsight claims beside what was found and names nobody, and beside bursts."""
        claims = dict(cleared.claims)
        for finding in self.found:
            if not finding.accuses and finding.end_s - finding.onset_s >= _LASTS_S:
                for sensor in {*finding.suspects} & {*claims}:
                    claims[sensor] = tuple(self._open_to(finding, sensor, claims[sensor]))
        for finding in self.found:
            if finding.accuses and finding.side is Side.AFTER and not finding.is_frozen:
                first_s = finding.onset_range_s[0] - _EARLIER_S
                earlier = unjudged((first_s, finding.onset_s), "it may have failed already")
                claims |= {sensor: (*claims[sensor], earlier) for sensor in {*finding.suspects} & {*claims}}
        for axis, (gyro, angle) in enumerate(zip(GYROS, ATTITUDE, strict=True)):
            why = f"{gyro} and the attitude part for a moment"
            open_to = tuple(unjudged(span_s, why) for span_s in self._bursts[axis])
            claims |= {sensor: (*claims[sensor], *open_to) for sensor in (gyro, angle)}
        return claims

    @cached_property
    def _bursts(self) -> tuple[list[Span], ...]:
        return tuple(bursts_of(self.model, axis) for axis in range(len(GYROS)))

    def _open_to(self, finding: Finding, sensor: str, spans: Sequence[SensorSpan]) -> Iterator[SensorSpan]:
        """Give a sensor's spans beside a finding that may be its fault: nothing is excluded that is as large."""
        first_s, last_s = self._span(finding)
        first_s, last_s = min(first_s, finding.onset_range_s[0]), max(last_s, finding.onset_range_s[1])
        for span in spans:
            inside = [time_s for time_s in (first_s, last_s) if span.start_s < time_s < span.end_s]
            for start_s, end_s in pairwise([span.start_s, *inside, span.end_s]):
                part = replace(span, start_s=start_s, end_s=end_s)
                if part.sizes is not None and part.meets(first_s, last_s):
                    part = replace(part, sizes=_beside(finding, sensor, part.sizes))
                yield part

    @property
    def curves(self) -> tuple[ErrorCurve, ...]:
        """What shows that somebody may have failed, an equation each, beside what a finding makes of it."""
        return curves_of(self.model, self.found)

    def _of(self, finding: Finding) -> Iterator[Claim]:
        if finding.accuses:
            span_s = self._span(finding)
            yield from claims_of(judgement_of(finding, span_s[1]), finding.suspects, span_s)

    def _span(self, finding: Finding) -> Span:
        """Return the broken side of a finding; both, where that is open."""
        start_s = finding.onset_s if finding.side is Side.AFTER else self.flight.blocks.start_s
        return start_s, finding.onset_s if finding.side is Side.BEFORE else finding.end_s


@lru_cache(maxsize=4)  # a verdict asks the same several times
def _hindsight(flight: Flight, failures: tuple[tuple[str, tuple[Failure, ...]], ...]) -> Hindsight:
    is_sure = not flight.is_assumed
    return hindsight_of(flight.blocks, is_driven=flight.is_driven, is_sure=is_sure, failures=dict(failures))


def _logged(flight: Flight) -> Iterator[tuple[str, tuple[str, float]]]:
    """Give how a log names gyros of IMUs that are mounted turned, and by which sign these read."""
    for imu in flight.compared:
        if imu.mounting.turned_deg:
            yield from zip(imu.channels, zip(imu.columns, imu.mounting.signs, strict=True), strict=True)


def _as_logged(claim: Claim, logged: Mapping[str, tuple[str, float]]) -> Claim:
    """Return a claim of gyros as the log names them: the engine knows them by the aircraft's axes."""
    sensor, span = claim
    suspects = tuple(logged.get(each, (each, 1.0))[0] for each in span.suspects)
    judgement = None if span.judgement is None else _named(span.judgement, logged)
    return logged.get(sensor, (sensor, 1.0))[0], replace(span, suspects=suspects, judgement=judgement)


def _named(judgement: Judgement, logged: Mapping[str, tuple[str, float]]) -> Judgement:
    """Return a judgement with the log's names; a size of a gyro that reads the other way round has the other sign."""
    if not {*judgement.candidates} & logged.keys():
        return judgement
    candidates = tuple(logged.get(each, (each, 1.0))[0] for each in judgement.candidates)
    is_reversed = len(candidates) == 1 and logged[judgement.candidates[0]][1] < 0.0
    turned = {*_SIGNED} if is_reversed else set()
    return replace(
        judgement,
        sensor=judgement.sensor and gyro_and_imu(candidates[0])[0],
        candidates=candidates,
        parameters={key: -value if key in turned else value for key, value in judgement.parameters.items()},
        intervals={
            key: (-high, -low) if key in turned else (low, high) for key, (low, high) in judgement.intervals.items()
        },
        reason="" if judgement.sensor else f"{' or '.join(candidates)} explains it",
    )


def _beside(finding: Finding, sensor: str, sizes: Sizes) -> Sizes:
    """Return which faults a sensor would have shown beside a finding that may be its own."""
    if finding.best.is_gain:
        return replace(sizes, factors=None)
    if finding.best.kind == "noise":
        return replace(sizes, noise=None)
    return replace(sizes, error=max(sizes.error, _SPARE * _reached(finding, sensor)))


def _reached(finding: Finding, sensor: str) -> float:
    """Return how far a sensor is off at most by a finding, in its unit; an angle is by all that its gyro's error turns.

    What an angle drifts by is far more than its gyro would be off, deg for deg/s.
    """
    if finding.best.kind == STEP:
        return abs(finding.size)
    is_turned = sensor in ATTITUDE and finding.best.suspect not in ATTITUDE
    return finding.reached_deg_s * (finding.end_s - finding.onset_s if is_turned else 1.0)


def parting(changes: Sequence[LevelChange], least_deg_s: float = 0.0) -> list[str]:
    """Return the gyros that part from the attitude so far that they may bend it."""
    far_deg_s = max(_PARTS_DEG_S, least_deg_s)
    return [GYROS[each.axis] for each in changes if each.of == "error" and abs(each.size) > far_deg_s]


def leaning(changes: Sequence[LevelChange], until_s: float) -> list[str]:
    """Return gyros that part from the attitude so long that its angle may be far off then; a heading bends nothing."""
    changed = [each for each in changes if each.of == "error" and each.stays and each.axis != YAW]
    return [GYROS[each.axis] for each in changed if abs(each.size) * (until_s - each.time_s) > BENT_DEG]


def failure_of(span: SensorSpan) -> Failure:
    """Return where a sensor failed, as hindsight takes it."""
    kind = None if span.judgement is None else span.judgement.kind
    return Failure(start_s=span.start_s, end_s=span.end_s, is_constant=kind in _CONSTANT)


def judged(flight: Flight) -> Judged:
    """Return what the engine says of a flight.

    >>> import numpy as np
    >>> from gtmbench.engine.blocks import blocks_of
    >>> from gtmbench.values.channels import ATTITUDE, GYROS
    >>> from gtmbench.values.record import Record
    >>> random = np.random.default_rng(1)
    >>> time_s = 0.1 * np.arange(1200)
    >>> angles = np.column_stack([np.sin(0.5 * time_s), np.sin(0.31 * time_s), 2.0 * np.sin(0.2 * time_s)])
    >>> gyros = np.gradient(angles, 0.1, axis=0) + 0.1 * random.standard_normal((1200, 3))
    >>> gyros[800:, 1] += 3.0
    >>> flown = Record(np.column_stack([gyros, angles]), channels=[*GYROS, *ATTITUDE], sample_period_s=0.1)
    >>> said = judged(Flight(blocks=blocks_of([flown]), is_driven=False))
    >>> [(each.named, each.best.kind, round(each.onset_s), round(each.size)) for each in said.found]
    [('q', 'bias', 81, 2)]
    >>> [(sensor, span.state.value) for sensor, span in said.accused], said.alarms[0].verdict
    ([('q', 'failed')], 'q failed')
    """
    findings = findings_of(flight.without(flight.repeats))
    found = with_doubts(findings.model, findings.found)
    said = Judged(found=found, model=findings.model.without_signatures)
    return replace(said, found=_unnamed_where_others_part(said)) if said.accused else said


def _unnamed_where_others_part(said: Judged) -> tuple[Finding, ...]:
    """Return findings that name nobody where another gyro parts from the attitude, too, and nothing explains that.

    An attitude that follows the gyros is bent by whichever failed. One of its own that leans further and further tells
    wrong turns about other axes: no factor is of these.
    """

    def doubtful(finding: Finding) -> Finding:
        axis = axis_number(finding.best.suspect)
        if said.flight.is_driven:
            before = [each for each in said.cleared.changes if each.time_s <= finding.shows_s]
            parts = parting(before, _ALIKE * finding.reached_deg_s)
        else:
            parts = leaning(said.cleared.changes, finding.end_s) if finding.best.is_gain else []
        others = [gyro for gyro in parts if GYROS.index(gyro) != axis]
        if finding.is_frozen or not finding.accuses or not others:
            return finding
        return replace(finding, doubt=f"{' and '.join(others)} parts from the attitude, too, and nothing explains it")

    return tuple(map(doubtful, said.found))
