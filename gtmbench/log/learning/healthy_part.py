"""What of opened logs is healthy, to learn from: spans of the log that is watched, and other logs, between pauses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from gtmbench.detectors.assumptions import basis_of
from gtmbench.detectors.protocol import is_ready
from gtmbench.log.learning.crashes import clear_parts, is_enough, left_of, part_without_mishap
from gtmbench.log.learning.undisturbed import Stretches, healthy_stretches
from gtmbench.log.opening.opened_log import Opened
from gtmbench.log.opening.records import healthy_spans, lively_seconds, whole_s, within
from gtmbench.log.self_check.refusal import Part
from gtmbench.values.record import Span
from gtmbench.verdict.timeline import Claim


@dataclass(frozen=True, kw_only=True, eq=False)
class Healthy:
    """What is healthy of opened logs."""

    opened: Opened
    spans: tuple[Span, ...]  # of the log that is watched; none where a monitor is ready, or other logs were given
    # what is learnt from; None where a monitor is ready, or nothing is learnt
    stretches: Stretches | None = field(repr=False)
    findings: tuple[str, ...]
    doubt: str = ""  # why silence says nothing, where a mishap leaves no better choice; "" where one is

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

    Where the engine accuses anybody, nothing is learnt.
    """
    if is_ready(opened.watcher) or basis_of(opened.watcher).is_whole:
        return Healthy(opened=opened, spans=(), stretches=None, findings=opened.findings)
    log, findings, doubt = opened.log, opened.findings, ""
    spans = healthy_spans(log, opened.asked.spans)
    accused = () if opened.judged is None else opened.judged.accused
    broken = [(span.start_s, span.end_s) for _, span in accused]
    moving = () if opened.own.motion is None else opened.own.motion.segments
    if opened.asked.says_healthy:
        findings += _contradicting(accused, spans)
        left = tuple(part for span in spans for part in left_of(span, broken))
        spans = left if any(is_enough(log, lively_seconds(moving), part) for part in left) else spans
    else:
        span, doubt = part_without_mishap(log, moving)
        spans = clear_parts(log, moving, span, broken)
        if not spans:
            why = "nothing is left to learn a bank from but what failed, so only the whole log is judged"
            return Healthy(opened=opened, spans=(), stretches=None, findings=(*findings, why))
        taken = " and ".join(f"{start_s:g}..{end_s:g} s" for start_s, end_s in spans)
        findings += (f"{taken} were taken as healthy, for nothing else was said",)
    of_logs = [(other.log, other.log.segments) for other in opened.others]
    of_logs += [(log, tuple(within(log, spans)))] if spans else []
    stretches, too_short = healthy_stretches(of_logs, opened.watcher.channels)
    return Healthy(opened=opened, spans=spans, stretches=stretches, findings=(*findings, *too_short), doubt=doubt)


def _contradicting(accused: Sequence[Claim], spans: Sequence[Span]) -> tuple[str, ...]:
    """Say whom the engine accuses in a span that was given as healthy."""
    told = [(sensor, failed) for sensor, failed in accused if any(failed.meets(*span) for span in spans)]
    return tuple(
        f"{sensor} fails from {failed.start_s:.1f} s on, in a span that was given as healthy" for sensor, failed in told
    )
