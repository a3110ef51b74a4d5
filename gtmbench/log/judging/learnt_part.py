"""The part that operators between sensors were learnt from, judged by others that were learnt on the end of the log.

What a fault in the first part teaches, the last part doesn't know, unless it lasts to the end; then both differ. Where
gyros and attitude are compared, the engine judges that part, and nothing of this is needed.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, field, replace

from gtmbench.detectors.predicting import PredictingMonitor, predicts
from gtmbench.detectors.protocol import Watch
from gtmbench.errors import InputError
from gtmbench.intake.tracks import overlaps, union
from gtmbench.jobs.progress import silent
from gtmbench.log.judging.monitored import excursions_of
from gtmbench.log.learning.healthy_part import chosen
from gtmbench.log.learning.learnt_monitor import Learnt, learnt
from gtmbench.log.opening.records import first_part, whole_s


@dataclass(frozen=True, kw_only=True, eq=False)
class SwapCheck:
    """What a monitor of the log's end says of the part that the log's own was learnt from."""

    monitor: PredictingMonitor
    watches: tuple[Watch, ...] = field(repr=False)  # of that part


def swapped(first: Learnt) -> SwapCheck | None:
    """Return what judges the part that was learnt from; None where the engine does, or nothing can."""
    is_judged = first.opened.flight is not None
    if is_judged or first.check.stops or not first.identified_s or not predicts(first.monitor):
        return None
    start_s, end_s = whole_s(first.opened.log)
    first_s = first_part(first.opened.log)  # as much of the end is learnt from as is of the beginning by default
    begins_s = max(end_s - (first_s[1] - first_s[0]), first.identified_s[-1][1])
    again = replace(first.opened, asked=replace(first.opened.asked, spans=((begins_s, end_s),), others=()))
    with contextlib.suppress(InputError):  # too little is left to learn from
        other = learnt(chosen(replace(again, others=())), silent)
        if not other.check.stops and predicts(other.monitor):
            part = first.opened.own.part(overlaps(union(first.identified_s), (start_s, begins_s)))
            outside = excursions_of(other.monitor, part)
            watches = tuple(other.monitor.watch(record, outside=outside) for record in part.records)
            return SwapCheck(monitor=other.monitor, watches=watches)
    return None
