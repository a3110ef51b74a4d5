"""Where a stream's motion is beyond what its monitor knows, as far as its rows tell by now.

Whether a row is beyond is known some tenths of a second later, and what was said meanwhile may have to be said anew: a
stream goes back to before, and on with the row left out, as a whole record is watched.
"""

from __future__ import annotations

from gtmbench.detectors.bank.calibrated import BankResiduals, CalibratedBank
from gtmbench.detectors.excursion import Excursion, rows_about
from gtmbench.detectors.monitor.excursions import Excursions
from gtmbench.detectors.monitor.regime import LATE_S, Regime, RegimeStream
from gtmbench.detectors.monitor.scores import Crossing, ScoreTrack, rises_in
from gtmbench.values.clock import even_times_s
from gtmbench.values.record import Record


class Surroundings:
    """The excursions of a stream, and which scores would have risen in them.

    `horizon`: how many rows back a row that comes in may change what is left out.
    """

    def __init__(self, monitor: CalibratedBank, regime: Regime) -> None:
        self._monitor, self._period_s = monitor, monitor.sample_period_s
        self._motion = RegimeStream(regime, self._period_s)
        self._tracks = {output: ScoreTrack(monitor, output) for output in monitor.operators}  # with nothing left out
        self._rises: list[Crossing] = []
        self._reach = {output: round(monitor.history_of(output) / self._period_s) for output in monitor.operators}
        self._start_s = 0.0
        self._taken = self._heard = 0  # rows
        self.horizon = round(LATE_S / self._period_s) + max(self._reach.values()) + 4
        self.excursions: tuple[Excursion, ...] = ()

    def take(self, rows: Record) -> int | None:
        """Take the next rows; return from which row on residuals are left out otherwise than was known; None as before.

        The end of an excursion that goes on is known before it comes.
        """
        if not self._taken:
            self._start_s = rows.start_s
        self._taken += len(rows)
        self._motion.take(rows)
        before, self.excursions = self.excursions, self._motion.excursions
        ends = {each.start_s: self._rows(each).stop for each in before}
        changed = [
            ends.get(each.start_s, max(self._rows(each).start - max(self._reach.values()), 0))
            for each in self.excursions
            if each not in before
        ]
        return min(changed, default=None)

    def left_out(self, since: int) -> list[tuple[str, range]]:
        """Return which rows of which residual stand on samples of an excursion, of those that go on after a row."""
        spans = [rows for rows in map(self._rows, self.excursions) if rows.stop + max(self._reach.values()) > since]
        return [
            (output, range(max(rows.start - reach, 0), rows.stop + reach))
            for output, reach in self._reach.items()
            for rows in spans
        ]

    def hear(self, residuals: BankResiduals, first: int, rows: range) -> None:
        """Take what some rows make known of residuals, as `extend` takes it; rows that come again are passed over."""
        if rows.stop <= self._heard:
            return
        new = range(max(rows.start, self._heard), rows.stop)
        self._rises += rises_in(self._tracks, residuals, first, new, self._start_s)
        self._heard = rows.stop

    def alarms(self) -> Excursions:
        """Return the excursions with the alarms that they would have raised, as known by now."""
        spans = list(map(self._rows, self.excursions))
        recent = self._heard - 2 * self.horizon
        self._rises = [rise for rise in self._rises if rise.row >= recent or any(rise.row in rows for rows in spans)]
        end_s = float(even_times_s(self._start_s, self._period_s, range(self._taken - 1, self._taken))[0])
        return Excursions(self._monitor, self._start_s, self.excursions, self._rises, end_s - LATE_S)

    def _rows(self, excursion: Excursion) -> range:
        return rows_about(excursion, self._start_s, self._period_s)
