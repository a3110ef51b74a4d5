"""The engine of a bank's monitor: residuals in, alarms out, whether a record's rows are all there or just came in.

A record that is watched as a whole and a stream differ in where the residuals come from and in what is kept of them;
what is made of them is made here.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.bank.calibrated import BankResiduals, CalibratedBank
from gtmbench.detectors.monitor.alarms import AlarmLogic
from gtmbench.detectors.monitor.excursions import Excursions
from gtmbench.detectors.monitor.memory import Memory
from gtmbench.detectors.monitor.scores import ScoreTrack, extend
from gtmbench.values.record import BoolArray, FloatArray

_NONE: Mapping[str, FloatArray] = MappingProxyType({})


class AlarmEngine:
    """A bank's scores and alarms as residuals come.

    `tracks`, by output. `memory`: of the rows whose residuals come. `before`, by output: healthy residuals on which the
    noise was learnt; of the others it is learnt on what comes. `keeps_changes`, `without`, `excursions`: as
    `AlarmLogic` has them.
    """

    def __init__(
        self,
        monitor: CalibratedBank,
        memory: Memory,
        before: Mapping[str, FloatArray] = _NONE,
        *,
        keeps_changes: bool = False,
        without: Iterable[str] = (),
        excursions: Excursions | None = None,
    ) -> None:
        self.memory = memory
        self.tracks = {output: ScoreTrack(monitor, output, before.get(output)) for output in monitor.operators}
        self.logic = AlarmLogic(
            monitor, memory, self.tracks, keeps_changes=keeps_changes, without=without, excursions=excursions
        )

    def take(self, residuals: BankResiduals, first: int, rows: range, there: BoolArray) -> None:
        """Take what some rows make known: residuals of rows from `first` on, and which samples of `rows` are there."""
        self.logic.missing.take(there)
        for output, row, raw, spread in extend(self.tracks, residuals, first, rows):
            self.memory.put(output, row, raw, spread)

    def run(self, stop: int) -> tuple[Alarm, ...]:
        """Return the alarms that the rows up to one raise or tell more of."""
        return self.logic.run(stop)

    def forget(self) -> None:
        """Let go of scores that nobody looks back at."""
        for track in self.tracks.values():
            track.forget()
