"""The part that a bank was learnt from, judged by one that was learnt on the end of the log: one swap, and no more.

It is for operators that no kinematics predict, which nothing else judges there. What a fault in the first part teaches,
the last part doesn't know, unless it lasts to the end; then the two parts differ.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, field, replace

from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.basis import basis_of
from gtmbench.detectors.predicting import PredictingMonitor, predicts
from gtmbench.detectors.protocol import Watch
from gtmbench.errors import InputError
from gtmbench.intake.spans import overlaps, union
from gtmbench.jobs.progress import silent
from gtmbench.study.log.healthy import chosen
from gtmbench.study.log.learnt import Learnt, learnt
from gtmbench.study.log.records import whole_s, within

_LAST_SHARE = 0.4  # of a log that is learnt from instead: as much as is by default


@dataclass(frozen=True, kw_only=True, eq=False)
class Swap:
    """What a monitor of the log's end says of the part that the log's own was learnt from.

    Attributes
    ----------
    monitor : PredictingMonitor
    watches : tuple of Watch
        Of that part.
    """

    monitor: PredictingMonitor
    watches: tuple[Watch, ...] = field(repr=False)

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """The first alarm of each fault."""
        return tuple(alarm for watch in self.watches for alarm in watch.faults)


def swapped(first: Learnt) -> Swap | None:
    """Return what judges the part that was learnt from; None where something else does, or nothing can.

    Parameters
    ----------
    first : Learnt
    """
    basis = basis_of(first.monitor)
    has_motion = bool(basis.kinematic) and first.opened.own.motion is not None
    if first.check.stops or not first.identified_s or has_motion or not predicts(first.monitor):
        return None
    start_s, end_s = whole_s(first.opened.log)
    begins_s = max(end_s - _LAST_SHARE * (end_s - start_s), first.identified_s[-1][1])
    again = replace(first.opened, asked=replace(first.opened.asked, spans=((begins_s, end_s),), others=()))
    with contextlib.suppress(InputError):  # too little is left to learn from
        other = learnt(chosen(replace(again, others=())), silent)
        if not other.check.stops and predicts(other.monitor):
            records = within(first.opened.log, overlaps(union(first.identified_s), (start_s, begins_s)))
            watches = tuple(other.monitor.watch(record) for record in records)
            return Swap(monitor=other.monitor, watches=watches)
    return None
