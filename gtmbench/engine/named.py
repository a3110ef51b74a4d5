"""A finding as others read it: a judgement in the words and units of faults, and an alarm."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from gtmbench.detectors.alarm import MOST_PROBABLE, Alarm, Judgement
from gtmbench.engine.explanations.angle import STEP
from gtmbench.engine.explanations.dead import DEAD
from gtmbench.engine.finding import FROZEN, Finding
from gtmbench.engine.imus.imu import gyro_and_imu
from gtmbench.faults.kinds.additive import Bias
from gtmbench.faults.kinds.shaping import ScaleFactor, SignFlip
from gtmbench.faults.registry import loaded_faults, shape_of, whole_log_of
from gtmbench.values.record import Span
from gtmbench.verdict.timeline import Claim, SensorSpan, State

WHOLE = "the whole log"  # the test of such alarms
_TURNED = 0.25  # about a factor of -1: the sign is wrong


def judgement_of(finding: Finding, time_s: float) -> Judgement:
    """Return what a finding says, known at a time.

    >>> from gtmbench.engine.relation import Effect
    >>> from gtmbench.engine.explanation import Explanation
    >>> half = (Explanation(suspect="q", kind="scale", effect=lambda _: Effect()), 0.0)
    >>> told = dict(first=0, last=9, onset_s=4.0, end_s=9.0, onset_range_s=(3.0, 5.0), evidence=50.0)
    >>> judged = judgement_of(Finding(ranked=(half,), size=-1.0, interval=(-1.1, -0.9), **told), 9.0)
    >>> judged.kind, judged.parameters["factor"], [round(end, 2) for end in judged.intervals["factor"]]
    ('scale_factor', 0.5, [0.48, 0.53])
    """
    kind, size, interval = _kind_of(finding), finding.size, finding.interval
    shape, whole = shape_of(kind), whole_log_of(kind)
    name = "" if shape is None else shape.parameter
    parameter = _left if finding.best.kind == DEAD else None if whole is None else whole.parameter
    if parameter is not None:
        size = parameter(finding.size)
        low, high = sorted(map(parameter, interval))
        interval = (low, high)
        kind = SignFlip.kind if abs(size + 1.0) < _TURNED else kind
    is_told = (whole is not None or kind == FROZEN) and kind != SignFlip.kind
    sensor, imu = (None, "") if finding.named is None else gyro_and_imu(finding.named)
    return Judgement(
        time_s=time_s,
        sensor=sensor,
        imu=imu,
        candidates=finding.suspects,
        kind=kind,
        parameters=({name: size} if is_told else {}) | {"onset_s": finding.onset_s},
        intervals=({name: interval} if is_told else {}) | {"onset_s": finding.onset_range_s},
        probability=_probability(finding, set(finding.suspects)),
        kind_probability=_probability(finding, {finding.best.suspect}, finding.best.kind),
        reason="" if finding.named else f"{' or '.join(finding.suspects)} explains it",
    )


def _left(share: float) -> float:
    """Return the factor of what lacks a share of each turn."""
    return 1.0 - share


def _probability(finding: Finding, suspects: set[str], kind: str | None = None) -> float | None:
    """Return how likely it is one of some suspects, or of a kind if it is; None where no explanation was weighed."""
    of = [(chance, each) for suspect, each, chance in finding.chances if suspect in suspects]
    whole = sum(chance for chance, _ in of) if kind else 1.0
    if not of or finding.is_healthy:
        return None
    return min(sum(chance for chance, each in of if kind in (None, each)) / whole, MOST_PROBABLE)


def claims_of(judgement: Judgement, suspects: Sequence[str], span_s: Span, reason: str = "") -> Iterator[Claim]:
    """Give what is claimed of those who may be behind a judgement: one failed, of several each is suspected."""
    is_one = len(suspects) == 1
    for sensor in suspects:
        yield (
            sensor,
            SensorSpan(
                start_s=span_s[0],
                end_s=span_s[1],
                state=State.FAILED if is_one else State.SUSPECTED,
                suspects=() if is_one else tuple(suspects),
                reason="" if is_one else reason,
                judgement=judgement,
            ),
        )


def alarm_of(finding: Finding, number: int, span_s: Span) -> Alarm:
    """Return an alarm of a finding, raised when as much of it was seen as names anybody."""
    start_s, end_s = span_s
    shows_s = min(max(finding.shows_s, start_s), end_s)
    return Alarm(
        number=number,
        time_s=shows_s,
        onset_s=start_s,
        source=finding.best.suspect,
        test=WHOLE,
        judgements=(judgement_of(finding, shows_s),),
        ended_s=None if finding.lasts else end_s,
    )


def _kind_of(finding: Finding) -> str:
    """Return the kind of fault that an explanation is."""
    called = {whole.name: kind for kind in loaded_faults() if (whole := whole_log_of(kind)) is not None}
    called |= {STEP: Bias.kind, DEAD: ScaleFactor.kind}
    return called.get(finding.best.kind, finding.best.kind)
