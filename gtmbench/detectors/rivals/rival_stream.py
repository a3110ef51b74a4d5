"""A rival at work: residuals, scores and alarms as samples come in, and which gyro it names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gtmbench.detectors.alarm import NOISE_CHANGED, Alarm, Judgement
from gtmbench.detectors.buffered_stream import ChunkResult, ChunkStream, taken
from gtmbench.detectors.protocol import Monitor
from gtmbench.detectors.rivals.judging import Judge
from gtmbench.detectors.rivals.signals import Generator
from gtmbench.values.record import BoolArray, FloatArray, Record

_LOOKS_S = 1.0  # after an alarm: whose score is greatest then?
_CLEARLY = 2.0  # times the next, or it can't tell
_SAME_S = 20.48  # the longest window: who alarms again before it has emptied tells of the same fault


@dataclass(kw_only=True)
class _Looking:
    """An alarm that is to be judged at a row, by the greatest score of each suspect until then."""

    number: int
    onset_row: int
    due_row: int
    peaks: dict[str, float] = field(default_factory=dict)


class RivalStream(ChunkStream):
    """A rival's monitor at work on samples as they come in.

    `generator`: of the residuals, which says nothing before it has settled. `judges`: of each of them.
    """

    def __init__(
        self, monitor: Monitor, generator: Generator, judges: Mapping[str, Judge], period_s: float, settles_s: float
    ) -> None:
        super().__init__(judges)
        self._monitor, self._period_s = monitor, period_s
        self._settled_row = round(settles_s / period_s)
        self._generator, self._judges = generator, judges
        self._above_row: float = -np.inf  # where a score was last above its threshold
        self._looking: _Looking | None = None

    def taken(self, chunk: Record) -> ChunkResult:
        """Return everything that is said of a chunk; parameters and errors are those of `push`."""
        monitor = self._monitor
        clock, new = taken(self._clock, chunk, monitor.channels, self._period_s, monitor.name)
        if not len(new):
            nothing = {name: np.zeros(0) for name in self._judges}
            return ChunkResult(np.zeros(0), nothing, {name: np.zeros(0, dtype=bool) for name in nothing}, ())
        rows = range(clock.count - len(new), clock.count)
        scores = self._scores(new.values, rows.start)
        told = {name: self._arming[name].push(values) for name, values in scores.items()}
        armed = {name: could for name, (could, _) in told.items()}
        rises = sorted((row, name) for name, (_, rows) in told.items() for row in rows)
        before = dict(self._alarms)
        known_s = np.round(clock.times_s(rows), 9)
        self._alarm(rises, scores, armed, known_s, rows)
        self._clock = clock
        return ChunkResult(known_s, scores, armed, self._news(before))

    def _scores(self, values: FloatArray, first: int) -> dict[str, FloatArray]:
        residuals = self._generator.push(values)
        residuals[: max(self._settled_row - first, 0)] = np.nan
        residuals[~np.isfinite(values).all(axis=1)] = np.nan  # a sensor that is missing isn't this alarm's business
        return {
            name: judge.push(column) for (name, judge), column in zip(self._judges.items(), residuals.T, strict=True)
        }

    def _alarm(
        self,
        rises: Sequence[tuple[int, str]],
        scores: Mapping[str, FloatArray],
        armed: Mapping[str, BoolArray],
        known_s: FloatArray,
        rows: range,
    ) -> None:
        """Raise the alarms of some rows, in time, and judge them when that is due."""
        with np.errstate(invalid="ignore"):
            above = np.logical_or.reduce([armed[name] & (values > 1.0) for name, values in scores.items()])
        last = np.maximum.accumulate(
            np.concatenate([[self._above_row], np.where(above, np.array(rows, float), -np.inf)])
        )
        begin = 0
        for row, name in rises:
            self._look(scores, known_s, rows, range(begin, row))
            begin, number = row, len(self._alarms)
            time_s, since = float(known_s[row]), rows.start + row - last[row]
            is_same = number > 0 and (since <= _SAME_S / self._period_s or self._alarms[number - 1].time_s == time_s)
            fault = self._alarms[number - 1].fault if is_same else number
            here = rows.start + row
            onset_row = self._judges[name].onset_row(here)
            onset_s = round(time_s - (here - onset_row) * self._period_s, 9)
            self._alarms[number] = Alarm(number=number, time_s=time_s, onset_s=onset_s, source=name, fault=fault)
            if not is_same and self._monitor.suspects:
                due_row = here + round(_LOOKS_S / self._period_s)
                self._looking = _Looking(number=number, onset_row=onset_row, due_row=due_row)
        self._look(scores, known_s, rows, range(begin, len(rows)))
        self._above_row = float(last[-1])

    def _look(self, scores: Mapping[str, FloatArray], known_s: FloatArray, rows: range, part: range) -> None:
        """Look at the scores of part of the rows after an alarm, and judge it at the last of them."""
        looking = self._looking
        if looking is None:
            return
        stop = min(part.stop, looking.due_row + 1 - rows.start)
        for suspect in self._monitor.suspects:
            own = [values[part.start : stop] for name, values in scores.items() if name.split()[0] == suspect]
            peak = float(np.fmax.reduce(np.concatenate(own), initial=0.0))
            looking.peaks[suspect] = max(looking.peaks.get(suspect, 0.0), peak)
        if looking.due_row < rows.start + part.stop:
            alarm = self._alarms[looking.number]
            judged = named(looking.peaks, float(known_s[looking.due_row - rows.start]))
            rows_since = range(looking.onset_row, looking.due_row + 1)
            if judged.candidates and all(self._is_noise(suspect, rows_since) for suspect in judged.candidates):
                judged = replace(judged, sensor=None, kind="noise", reason="its level did", doubt=NOISE_CHANGED)
            self._alarms[looking.number] = replace(alarm, judgements=(judged,))
            self._looking = None

    def _is_noise(self, suspect: str, rows: range) -> bool:
        """Tell whether all that a suspect's residuals have shown over some rows is noise of another level."""
        return all(judge.is_noise(rows) for name, judge in self._judges.items() if name.split()[0] == suspect)


def named(peaks: Mapping[str, float], time_s: float) -> Judgement:
    """Return the judgement of an alarm: the suspect whose score is clearly the greatest, and above its threshold.

    Parameters
    ----------
    peaks : mapping of suspect to float
        The greatest score of each since the alarm, over its threshold.
    time_s : float
        When that is known.

    Examples
    --------
    >>> named({"p": 3.0, "q": 1.2, "r": 0.1}, 5.0).sensor
    'p'
    >>> named({"p": 3.0, "q": 2.0, "r": 0.1}, 5.0).verdict
    'undecided: p or q'
    """
    ranked = sorted(peaks, key=lambda suspect: -peaks[suspect])
    greatest = peaks[ranked[0]]
    if greatest <= 1.0:
        return Judgement(time_s=time_s, sensor=None, candidates=tuple(ranked), reason="no gyro's own score is above 1")
    alike = tuple(suspect for suspect in ranked if _CLEARLY * peaks[suspect] >= greatest)
    if len(alike) == 1:
        return Judgement(time_s=time_s, sensor=ranked[0], candidates=alike)
    return Judgement(time_s=time_s, sensor=None, candidates=alike, reason="their scores are alike")
