"""Watching a whole record with a monitor: the engine of a stream, fed with all rows at once."""

from __future__ import annotations

import numpy as np

from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.bank.calibrated import BankResiduals, CalibratedBank
from gtmbench.detectors.monitor.alarms import Arming, Engine
from gtmbench.detectors.monitor.memory import Memory
from gtmbench.detectors.monitor.scores import level_of, tracks_of
from gtmbench.detectors.protocol import Score
from gtmbench.method.alarms import BoolArray
from gtmbench.record import Record


def scores_and_alarms(
    monitor: CalibratedBank, record: Record, residuals: BankResiduals
) -> tuple[dict[str, Score], tuple[Alarm, ...]]:
    """Return every residual's level, where it was armed, and the alarms."""
    tracks = tracks_of(monitor, residuals)
    engine = Engine(monitor, Memory.of(monitor, record, residuals), tracks, keeps_changes=True)
    engine.run(len(record))
    arming = {one.output: one for one in engine.arming}
    return {output: _score(monitor, record, arming[output]) for output in tracks}, tuple(engine.alarms)


def _score(monitor: CalibratedBank, record: Record, arming: Arming) -> Score:
    level = level_of(arming.track, record)
    since = arming.disarmed_row
    return Score(
        name=arming.output,
        values=level.values,
        known_s=level.known_s,
        channels=tuple(name for name in monitor.bank.channels if arming.output in monitor.bank.affects(name)),
        armed=np.isfinite(level.values) & _armed(arming, len(record)),
        disarmed_s=None if since is None else float(record.time_s[since]),
    )


def _armed(arming: Arming, rows: int) -> BoolArray:
    """Return whether a row's level, once known, could have raised an alarm."""
    armed = np.zeros(rows + arming.track.ahead, dtype=bool)  # when it is known
    for row, able in arming.changes or ():
        armed[row:] = able
    return armed[arming.track.ahead :]
