"""What of opened logs is healthy, to learn from: spans of the log that is watched, and other logs, between pauses."""

from __future__ import annotations

from dataclasses import dataclass, field

from gtmbench.detectors.protocol import is_ready
from gtmbench.study.log.identified import Stretches, healthy_stretches
from gtmbench.study.log.mishaps import flying_part_but
from gtmbench.study.log.opened import Opened
from gtmbench.study.log.records import healthy_spans, whole_s, within
from gtmbench.study.log.self_check.outcome import Part
from gtmbench.values.record import Span


@dataclass(frozen=True, kw_only=True, eq=False)
class Healthy:
    """What is healthy of opened logs.

    Attributes
    ----------
    opened : Opened
    spans : tuple of (start, end)
        Of the log that is watched; none where a monitor is ready, or other logs were given.
    stretches : Stretches or None
        What is learnt from; None where a monitor is ready.
    findings : tuple of str
    doubt : str
        Why silence says nothing, where a mishap leaves no better choice; "" where one is.
    """

    opened: Opened
    spans: tuple[Span, ...]
    stretches: Stretches | None = field(repr=False)
    findings: tuple[str, ...]
    doubt: str = ""

    @property
    def parts(self) -> list[Part]:
        """The logs that hold it, other ones first, each as far as it is healthy."""
        of_others = [other.part([whole_s(other.log)]) for other in self.opened.others]
        return [*of_others, self.opened.own.part(self.spans)] if self.spans else of_others

    @property
    def provenance(self) -> dict[str, object]:
        """Where it comes from, as plain values."""
        logs = [other.log for other in self.opened.others] + [self.opened.log] * bool(self.spans)
        return {
            "source": "logs",
            "logs": [{"name": log.path.name} for log in logs],
            "healthy_s": [list(span) for span in self.spans],
        }


def chosen(opened: Opened) -> Healthy:
    """Choose what is healthy: what was said to be, or else the first part of the log in which it moves, but no mishap.

    Raises
    ------
    InputError
        Where that holds nothing of the log, or too little.
    """
    if is_ready(opened.watcher):
        return Healthy(opened=opened, spans=(), stretches=None, findings=opened.findings)
    log, findings, doubt = opened.log, opened.findings, ""
    spans = healthy_spans(log, opened.asked.spans)
    if not opened.asked.says_healthy:
        motion = opened.own.motion
        span, doubt = flying_part_but(log, () if motion is None else motion.segments)
        spans = (span,)
        findings += (f"{spans[0][0]:g}..{spans[0][1]:g} s were taken as healthy, for nothing else was said",)
    of_logs = [(other.log, other.log.segments) for other in opened.others]
    of_logs += [(log, tuple(within(log, spans)))] if spans else []
    stretches, too_short = healthy_stretches(of_logs, opened.watcher.channels)
    return Healthy(opened=opened, spans=spans, stretches=stretches, findings=(*findings, *too_short), doubt=doubt)
