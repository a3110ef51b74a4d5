"""The monitor that is learnt from what is healthy of logs, once their wiring has been checked; one that is ready stays.

Whatever is wrong where something is learnt stops the watch: the stages behind pass on what has stopped.
"""

from __future__ import annotations

import contextlib
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol, runtime_checkable

from gtmbench.detectors.bank_detector import AutoDetector
from gtmbench.detectors.monitor.regime import Regime
from gtmbench.detectors.protocol import Detector, Monitor, is_recipe, with_provenance
from gtmbench.errors import InputError
from gtmbench.jobs.progress import Progress
from gtmbench.log.learning.healthy_part import Healthy, chosen
from gtmbench.log.learning.undisturbed import LeftOut, Stretches, undisturbed
from gtmbench.log.opening.opened_log import Opened, without_heading
from gtmbench.log.opening.opened_log import opened as opened_anew
from gtmbench.log.opening.question import Asked
from gtmbench.log.opening.records import outside, whole_s
from gtmbench.log.self_check.refusal import ALL, IDENTIFIED, Doubt, SelfCheck, check_identified, check_wiring
from gtmbench.values.channels import ATTITUDE, GYROS, axis_of
from gtmbench.values.record import Record, Span

IN_TIME = "; read in time"  # behind the cause of a log that is late throughout
_R = "r"


@dataclass(frozen=True, kw_only=True, eq=False)
class Learnt:
    """A monitor for an opened log."""

    opened: Opened
    monitor: Monitor | Detector  # the detector where the check stopped it before it was calibrated
    identified_s: tuple[Span, ...] = ()  # the spans of the log that it was learnt on
    # the last of them: the noise that was there before watching begins
    before: Record | None = field(default=None, repr=False)
    check: SelfCheck = field(default=SelfCheck(), repr=False)  # where it stops, nothing is watched
    left_out: tuple[LeftOut, ...] = ()  # what of what is healthy wasn't learnt from
    findings: tuple[str, ...]


def learnt(healthy: Healthy, progress: Progress) -> Learnt:
    """Calibrate a detector on what is healthy, where the wiring of that is as it should be.

    A log whose angles, or gyros, are all late alike is read in time: so it was logged, and nothing failed. Where r
    can't be explained, either it or the heading is wrong: p and q are watched without the heading.
    """
    found = _learnt(healthy, progress)
    question = healthy.opened.asked
    if late := _all_late(found.check, question):
        with contextlib.suppress(InputError):
            in_time = learnt(chosen(opened_anew(question.mapped(late))), progress)
            if not in_time.check.causes:
                return replace(in_time, findings=(f"{found.check.causes[0].text}{IN_TIME}", *in_time.findings))
    without = without_heading(question)
    is_asked = isinstance(question.watcher, AutoDetector) and without.mapping != question.mapping
    if not (is_asked and found.check.of_heading):
        return found
    with contextlib.suppress(InputError):  # too little to learn from: it stays as it was found
        others = _learnt(chosen(opened_anew(without)), progress)
        if not others.check.stops:
            return _with_doubt_of_r(found, others)
    return found


def _all_late(check: SelfCheck, question: Asked) -> tuple[str, ...]:
    """Return how angles, or gyros, are mapped in time that are all late alike; none where anything else is wrong."""
    if len(check.causes) != 1 or question.others:
        return ()
    (cause,) = check.causes
    late = {name for change in cause.changes if change.kind == "late" for name in change.channels}
    is_alone = len(cause.changes) == 1 and late in ({*ATTITUDE}, {*GYROS})
    mapping = tuple(shlex.split(cause.to_type)[1::2]) if is_alone else ()
    return () if {*mapping} <= {*question.mapping} else mapping


def _with_doubt_of_r(found: Learnt, others: Learnt) -> Learnt:
    """Return a monitor of p and q with the doubt that remains of r."""
    doubt = f"{found.check.of_heading}, so r or the heading is wrong; p and q are watched without the heading"
    untold = others.opened.unwatched.get(_R)
    return replace(
        others,
        opened=replace(others.opened, unwatched={**others.opened.unwatched, _R: doubt}),
        check=replace(others.check, doubts=(*others.check.doubts, Doubt(text=doubt, sensors=axis_of(_R)))),
        findings=tuple(doubt if finding == untold else finding for finding in others.findings),
    )


def _learnt(healthy: Healthy, progress: Progress) -> Learnt:
    opened = healthy.opened
    if not is_recipe(opened.watcher):
        return Learnt(opened=opened, monitor=opened.watcher, findings=healthy.findings)
    if healthy.stretches is None:
        return _untaught(healthy)
    try:
        return _taught(healthy, opened.watcher, healthy.stretches, progress)
    except InputError as error:
        is_stated = opened.asked.says_healthy or not isinstance(opened.asked.watcher, AutoDetector)
        if opened.judged is None or is_stated:  # whoever says what to learn is told why it can't be
            raise
        return _untaught(healthy, f"no bank is learnt, so only the whole log is judged: {error}")


def _untaught(healthy: Healthy, *why: str) -> Learnt:
    """Return what learns nothing, where too little is healthy: the whole log shows how it is wired."""
    opened = healthy.opened
    wired = check_wiring(opened.watcher, [opened.own.part([whole_s(opened.log)])], ALL)
    return Learnt(opened=opened, monitor=opened.watcher, check=wired, findings=(*healthy.findings, *why))


def _taught(healthy: Healthy, watcher: Detector, stretches: Stretches, progress: Progress) -> Learnt:
    opened = healthy.opened
    monitor: Monitor | Detector = watcher
    findings, parts = healthy.findings, healthy.parts
    check = check_wiring(watcher, parts, IDENTIFIED)
    if not check.stops:
        stretches = undisturbed(watcher, stretches)
        findings += tuple(stretches.reasons)
        moved = (record for part in parts for record in outside(part.motion, stretches.left_out_of(part.log)))
        provenance = healthy.provenance | {"regime": Regime.of(moved).table}
        rate = opened.asked.false_alarms_per_hour
        monitor = _calibrated(watcher, stretches.records, rate, provenance, progress)
        check = check_identified(check, monitor, stretches.records)
    check = _in_all_of_it(check, healthy)
    if healthy.doubt:
        check = replace(check, doubts=(Doubt(text=healthy.doubt, is_learnt=True), *check.doubts))
    was_learnt = bool(check.explained) or not check.stops
    return Learnt(
        opened=opened,
        monitor=monitor if was_learnt else watcher,
        identified_s=healthy.spans if was_learnt else (),
        before=stretches.records[-1] if healthy.spans and was_learnt else None,
        check=check,
        left_out=stretches.left_out,
        findings=findings,
    )


def _in_all_of_it(check: SelfCheck, healthy: Healthy) -> SelfCheck:
    """Return a check with the cause that all of the log shows, where its healthy part is too calm to tell."""
    is_open = not check.causes and (check.stops or any(not each.is_shown for each in check.explained))
    if not healthy.spans or not is_open:
        return check
    opened = healthy.opened
    whole = check_wiring(opened.watcher, [opened.own.part([whole_s(opened.log)])], ALL)
    return replace(whole, explained=check.explained) if whole.causes else check


def _calibrated(
    detector: Detector,
    records: Sequence[Record],
    rate: float | None,
    provenance: Mapping[str, object],
    progress: Progress,
) -> Monitor:
    """Calibrate on a log's healthy stretches: in its own way for one flight, where a detector has one."""
    if isinstance(detector, _LearnsOnFlight):
        return detector.calibrate_on_flight(records, rate, provenance=provenance, progress=progress)
    return with_provenance(detector.calibrate(records, rate, progress=progress), provenance)


@runtime_checkable
class _LearnsOnFlight(Protocol):
    def calibrate_on_flight(
        self, records: Sequence[Record], rate: float | None, *, provenance: Mapping[str, object], progress: Progress
    ) -> Monitor: ...
