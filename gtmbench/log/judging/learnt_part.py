"""The part that a bank was learnt from, judged by one that was learnt on the end of the log: one swap, and no more.

What a fault in the first part teaches, the last part doesn't know, unless it lasts to the end; then both differ. Where
gyros and attitude are compared, this is for what is short or fast, as an oscillation of seconds: what lasts, the engine
tells. So it is done only where something stands out in what was learnt from.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, field, replace

from gtmbench.detectors.alarm import MISSING, Alarm
from gtmbench.detectors.predicting import PredictingMonitor, predicts
from gtmbench.detectors.protocol import Watch, is_recipe
from gtmbench.errors import InputError
from gtmbench.intake.tracks import overlaps, union
from gtmbench.jobs.progress import Progress, silent
from gtmbench.log.judging.claims import began_s
from gtmbench.log.judging.monitored import excursions_of
from gtmbench.log.learning.healthy_part import chosen
from gtmbench.log.learning.learnt_monitor import Learnt, learnt
from gtmbench.log.learning.undisturbed import stands_out
from gtmbench.log.opening.records import first_part, whole_s


@dataclass(frozen=True, kw_only=True, eq=False)
class SwapCheck:
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
        """The first alarm of each fault; what is missing there is no fault of what was learnt."""
        return tuple(alarm for watch in self.watches for alarm in watch.faults if alarm.test != MISSING)


def crossed(first: Learnt, progress: Progress) -> tuple[Learnt, SwapCheck | None]:
    """Return a bank that was learnt where nobody failed, as far as a swap tells, and that swap; None without one.

    `first`: where the swap accuses nobody, it stays.
    """
    swap = swapped(first)
    if swap is None or first.opened.judged is None:
        return first, swap
    end_s = first.identified_s[-1][1]
    accusing = [alarm for alarm in swap.alarms if alarm.accuses]
    broken = [(began_s(alarm), end_s if alarm.ended_s is None else alarm.ended_s) for alarm in accusing]
    if not broken:
        return first, swap
    with contextlib.suppress(InputError):  # too little is left to learn from
        again = learnt(chosen(first.opened, broken), progress)
        if again.identified_s and not again.check.stops:
            return again, swap
    return first, swap


def swapped(first: Learnt) -> SwapCheck | None:
    """Return what judges the part that was learnt from; None where nothing stands out there, or nothing can."""
    if first.check.stops or not first.identified_s or not predicts(first.monitor) or not _stands_out(first):
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


def _stands_out(first: Learnt) -> bool:
    """Tell whether a gyro changes against the attitude, or a residual is large for a moment, where it was learnt.

    Where no engine judges that part, nobody else does.
    """
    opened, watcher = first.opened, first.opened.watcher
    if opened.judged is None or opened.judged.cleared.changes or not is_recipe(watcher):
        return True
    return stands_out(watcher, opened.log, first.identified_s)
