"""The verdict on a log: one pure function of its timeline and of what is asked."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cached_property
from types import MappingProxyType

from gtmbench.values.channels import GYROS
from gtmbench.verdict.scope import Scope
from gtmbench.verdict.timeline import SensorSpan, Sizes, State, Timeline


class Outcome(IntEnum):
    """The outcome for a log; the value is the command's exit code.

    Examples
    --------
    >>> import gtmbench as gb
    >>> [(outcome.name, outcome.value) for outcome in gb.Outcome]  # the exit codes of `gtmbench monitor`
    [('HEALTHY', 0), ('FAILED', 1), ('UNKNOWN', 3)]
    """

    HEALTHY = 0
    FAILED = 1
    UNKNOWN = 3  # the exit code


@dataclass(frozen=True, kw_only=True, eq=False)
class LogVerdict:
    """The verdict on a log.

    Attributes
    ----------
    timeline : Timeline
        As far as the scope asks: spans that are clear up to a size above its limits aren't judged.
    scope : Scope
    outcome : Outcome
        Failed if an asked sensor failed or is suspected, or any other sensor failed; unknown if an asked one isn't
        judged for too much of the time in motion, or nothing moves; healthy otherwise.

    Examples
    --------
    >>> from gtmbench.verdict.timeline import laid_out
    >>> small, large = Sizes(error=0.5, within_s=60.0), Sizes(error=7.0, within_s=60.0)
    >>> clear = [SensorSpan(start_s=0.0, end_s=60.0, state=State.CLEAR, sizes=each) for each in (small, large)]
    >>> timeline = laid_out((0.0, 60.0), {"p": clear[:1], "q": clear[1:]}, motion_s=[(0.0, 60.0)])
    >>> [verdict_of(timeline, Scope(sensors=names)).outcome.name for names in (("p",), ("p", "q"))]
    ['HEALTHY', 'UNKNOWN']
    """

    timeline: Timeline = field(repr=False)
    scope: Scope
    outcome: Outcome

    @property
    def exit_code(self) -> int:
        """The exit code of a command that says it."""
        return int(self.outcome)

    @cached_property
    def failed(self) -> tuple[tuple[str, SensorSpan], ...]:
        """The failures of all sensors of the log, asked or not, in order of time."""
        return _in_time(self.timeline, tuple(self.timeline.sensors), State.FAILED)

    @cached_property
    def suspected(self) -> tuple[tuple[str, SensorSpan], ...]:
        """The suspicions, of any sensor, in order of time."""
        return _in_time(self.timeline, tuple(self.timeline.sensors), State.SUSPECTED)

    @cached_property
    def unjudged(self) -> tuple[str, ...]:
        """The asked sensors that aren't judged for too much of the time in motion."""
        return tuple(sensor for sensor in self.scope.sensors if self.judged_share(sensor) < self.scope.judged)

    def judged_share(self, *sensors: str) -> float:
        """Return in which share of the time in motion that one of some sensors is judged which is judged least."""
        return min(map(self.timeline.judged_share, sensors), default=0.0)

    def sizes_of(self, sensor: str) -> Sizes | None:
        """Return the worst sizes of all spans in which a sensor is clear; None where it is in none."""
        clear = [span.sizes for span in self.timeline.of(sensor, State.CLEAR) if span.sizes is not None]
        if not clear:
            return None
        factors = [each.factors for each in clear]
        noises = [each.noise for each in clear]
        known = [each for each in factors if each is not None]
        loud = [each for each in noises if each is not None]
        return Sizes(
            error=max(each.error for each in clear),
            within_s=max(each.within_s for each in clear),
            factors=(min(low for low, _ in known), max(high for _, high in known))
            if len(known) == len(factors)
            else None,
            noise=max(loud) if len(loud) == len(noises) else None,
        )

    def reasons_of(self, sensor: str) -> tuple[str, ...]:
        """Return why a sensor isn't judged, the reason that costs most of the time in motion first."""
        lost_s: dict[str, float] = {}
        for span in self.timeline.of(sensor, State.NOT_JUDGED):
            cost_s = self.timeline.moving_s(span) + 1e-6 * span.duration_s
            lost_s[span.reason] = lost_s.get(span.reason, 0.0) + cost_s
        return tuple(sorted(lost_s, key=lambda reason: -lost_s[reason]))


def verdict_of(timeline: Timeline, scope: Scope) -> LogVerdict:
    """Return the verdict on a timeline for what is asked."""
    asked = within(timeline, scope)
    return LogVerdict(timeline=asked, scope=scope, outcome=_outcome(asked, scope))


def _outcome(timeline: Timeline, scope: Scope) -> Outcome:
    accused = any(timeline.of(sensor, State.FAILED, State.SUSPECTED) for sensor in scope.sensors)
    if accused or any(timeline.of(sensor, State.FAILED) for sensor in timeline.sensors):
        return Outcome.FAILED
    if any(timeline.judged_share(sensor) < scope.judged for sensor in scope.sensors) or not scope.sensors:
        return Outcome.UNKNOWN
    return Outcome.HEALTHY


def within(timeline: Timeline, scope: Scope) -> Timeline:
    """Return a timeline in which no span is clear whose sizes lie above the limits of a scope.

    >>> from gtmbench.verdict.timeline import laid_out
    >>> loud = SensorSpan(start_s=0.0, end_s=9.0, state=State.CLEAR, sizes=Sizes(error=7.0, within_s=60.0))
    >>> [span] = within(laid_out((0.0, 9.0), {"q": [loud]}), Scope(sensors=("q",))).sensors["q"]
    >>> span.state.value, span.reason
    ('not judged', 'only an error of 7 deg/s or more would show')
    """
    sensors = {
        sensor: tuple(_held_against(span, sensor, scope) for span in spans)
        for sensor, spans in timeline.sensors.items()
    }
    return replace(timeline, sensors=MappingProxyType(sensors))


def _held_against(span: SensorSpan, sensor: str, scope: Scope) -> SensorSpan:
    if span.state is not State.CLEAR or span.sizes is None:
        return span
    if span.sizes.error > scope.limit_of(sensor):
        unit = "deg/s" if sensor in GYROS else "deg"
        why = span.reason or f"only an error of {span.sizes.error:.2g} {unit} or more would show"
        return replace(span, state=State.NOT_JUDGED, reason=why)
    if scope.factor is not None and sensor in GYROS and not _shows(span.sizes, scope.factor):
        return replace(span, state=State.NOT_JUDGED, reason=f"a factor of {scope.factor:g} would not show")
    return span


def _shows(sizes: Sizes, factor: float) -> bool:
    if sizes.factors is None:
        return False
    low, high = sizes.factors
    return factor <= low or factor >= high


def _in_time(timeline: Timeline, sensors: tuple[str, ...], state: State) -> tuple[tuple[str, SensorSpan], ...]:
    found = [(sensor, span) for sensor in sensors for span in timeline.of(sensor, state)]
    return tuple(sorted(found, key=lambda each: each[1].start_s))
