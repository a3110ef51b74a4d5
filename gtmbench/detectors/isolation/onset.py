"""When a fault began, with an interval: estimated by itself, once it is known which sensor failed and how.

What the fault adds is known then, so that each row before the alarm may be tried as the onset. D(o) is -2 log
likelihood of the whitened residuals once what is added from row o on is undone. With a flat prior,

    p(o) ~ exp(-(D(o) - min D) / (2 kappa)),    kappa >= 1,

where kappa allows for the model's error; the estimate is the median, the interval holds 95 %. Of faults that read
anything (noise, what belongs to no kind) D is that of samples whose variance is greater from o on. Readings that are
repeated or rounded date themselves: by the first row that is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from gtmbench.detectors.alarm import Judgement
from gtmbench.detectors.bank.calibrated import MOST
from gtmbench.detectors.isolation.case import Case, own
from gtmbench.detectors.isolation.fits import TAIL, rows_between
from gtmbench.detectors.isolation.noise import spikes_in
from gtmbench.detectors.isolation.own_noise import ALIKE
from gtmbench.detectors.isolation.standing import meeting, passing, repeats, whole
from gtmbench.detectors.isolation.suspect import Suspect
from gtmbench.faults.fault import Fault
from gtmbench.faults.kinds.replacing import Delay
from gtmbench.faults.kinds.shaping import Hysteresis, RateSaturation, Saturation
from gtmbench.faults.registry import grows, how_of, loaded_faults
from gtmbench.faults.shape import CONSTANT
from gtmbench.values.channels import axis_of
from gtmbench.values.record import BoolArray, FloatArray

EARLIER_S = 15.0  # before the case: how far back an onset is looked for
LATER_S = 3.0  # from where the fault is sure on: later rows say nothing of its onset
_CLOSE_S = 0.1  # an onset that is known so closely isn't looked for again
_NEAR_S = 4.0  # before the test's estimate, of all but a drift
_KAPPA, _KAPPA_WALK = 8.0, 2.0  # of a walk the likelihood is exact, but for its gain
_KAPPA_LATE = 32.0  # a late reading is off by a small difference, so that the model's error weighs more
_FLOOR = 9.2  # of D / kappa over its least: a hundredth of the likelihood, and less isn't looked at closer
_TRIED = 24  # onsets at a time
_SHAPED = ("linear", "gain", "sign", "fixed", "search", "turned")  # of which their class says what each sample reads
_LOUDER = 1.2  # times the variance, at least, of noise that is greater
_OF_SPIKE = 0.5  # of a spike's size, that another one has at least
_PLAY_S = 1.0  # within which a sensor with play repeats itself again
_BLOCK_S = 0.25  # means of a residual that walks
_SAME = 1e-9  # of a value that is held


Added = Callable[[int], FloatArray]  # what a fault adds to the readings, by the row with which it begins


class Onset(NamedTuple):
    """When a fault began, in seconds: the estimate, and between which times with a probability of 95 %."""

    time_s: float
    low_s: float
    high_s: float


def dated(begin: Callable[[], Case], judged: Judgement, last: Judgement | None) -> Judgement:
    """Return a judgement with the onset of each fault that it names, in its parameters and intervals.

    `begin`: gives the case from `EARLIER_S` before the one that was judged to `LATER_S` after its alarm. `last`: the
    one before: what it told closely of the same sensor and kind stands.
    """
    if judged.together:
        return replace(judged, together=tuple(dated(begin, each, None) for each in judged.together))
    onset = _known_closely(judged, last) or (None if judged.sensor is None else onset_of(begin(), judged))
    if onset is None:
        return judged
    return replace(
        judged,
        parameters=judged.parameters | {"onset_s": onset.time_s},
        intervals=judged.intervals | {"onset_s": (onset.low_s, onset.high_s)},
    )


def _known_closely(judged: Judgement, last: Judgement | None) -> Onset | None:
    """Return the onset that a judgement before told closely, of the same sensor and kind; None where none did."""
    if last is None or (last.sensor, last.kind) != (judged.sensor, judged.kind) or "onset_s" not in last.intervals:
        return None
    low_s, high_s = last.intervals["onset_s"]
    return Onset(last.parameters["onset_s"], low_s, high_s) if high_s - low_s < _CLOSE_S else None


def onset_of(case: Case, judged: Judgement) -> Onset | None:
    """Return when the fault began that a judgement names; None where that can't be told."""
    channel = str(judged.sensor)
    suspect = None if channel in case.driving else Suspect.of(case, channel)
    if suspect is None:
        return None
    shown = _shown_by_readings(suspect, judged)
    if shown is not None:
        return _between(suspect, *shown)
    how = how_of(judged.kind)
    if how == "spikes":
        return _of_spikes(suspect, judged)
    path = next((each for each in suspect.paths if each.output == channel and each.is_alone), None)
    if how == "walk" and path is not None:
        return _of_walk(suspect, float(path.kernel.sum()), judged.parameters["gain"])
    near = round(_NEAR_S / case.period_s)
    cls = loaded_faults().get(str(judged.kind))
    first = 0 if cls is not None and grows(cls) else max(suspect.onset - near, 0)
    kappa = _KAPPA_LATE if judged.kind == Delay.kind else _KAPPA
    return _likeliest(suspect, _deviance(suspect, judged), first, kappa)


def _deviance(suspect: Suspect, judged: Judgement) -> Callable[[list[int]], FloatArray]:
    """Return what gives D of onsets, by rows from the suspect's first on."""
    if judged.swapped:
        other = Suspect.of(suspect.case, str(judged.partner))
        return _undone(_swapped(suspect, other)) if other is not None else _loudness(_loudest(suspect), suspect.sure)
    added = _added(suspect, judged)
    if added is not None:
        return _undone([(suspect, added)])
    innovations = own(suspect.channel)
    if how_of(judged.kind) == "white" and innovations in suspect.outputs:
        white = np.sqrt(ALIKE) * suspect.case.white[innovations][suspect.case.start :]
        return _loudness(white[_rows(suspect)], suspect.sure)
    return _loudness(_loudest(suspect), suspect.sure)


def _between(suspect: Suspect, low: int, row: int, high: int) -> Onset:
    """Return an onset by rows from the suspect's first on: it was after the row before."""
    low_s, time_s, high_s = (float(suspect.time_s[max(at, 0)]) for at in (low, row, high))
    return Onset(round(time_s, 9), round(low_s - suspect.case.period_s, 9), round(high_s, 9))


# ---- readings that date themselves ----


def _shown_by_readings(suspect: Suspect, judged: Judgement) -> tuple[int, int, int] | None:
    """Return the onset's row, with the least and the most that it may be, where the readings show it."""
    readings, sure, parameters, how = suspect.measured, suspect.sure, judged.parameters, how_of(judged.kind)
    if how in CONSTANT:
        value = parameters["value"]
        row = _first_of_run(np.abs(readings - value) <= _SAME * max(abs(value), 1.0), sure)
        return None if row is None else (row, row + (how == "last"), row + 1)  # a jam's value was read before
    if how == "rounded":
        row = _first_of_run(whole(readings, parameters["quantum"]), sure)
        return None if row is None else (row, row, row)
    if how == "repeated":
        row = _first_repeated(suspect, parameters["hold_s"])
        return None if row is None else (row - 1, row - 1, row - 1)
    if judged.kind == Hysteresis.kind and suspect.channel in suspect.case.habits:
        is_counted = suspect.case.habits[suspect.channel].is_counted
        row = None if is_counted else _first_repeated(suspect, _PLAY_S)
        return None if row is None else (row - 1, row, row)
    if judged.kind == Saturation.kind:
        return _at_limit(np.abs(readings), parameters["limit"], sure)
    if judged.kind == RateSaturation.kind:
        steps = np.abs(np.diff(readings, prepend=readings[0]))
        return _at_limit(steps, parameters["rate_limit"] * suspect.case.period_s, sure)
    return None


def _first_repeated(suspect: Suspect, within_s: float) -> int | None:
    """Return the first reading that repeats the one before, of those that follow each other within a time."""
    repeated = np.concatenate([[False], repeats([suspect.measured])])
    wide = np.ones(2 * round(within_s / suspect.case.period_s) + 1)
    row = _first_of_run(np.convolve(repeated, wide, mode="same") > 0.5, suspect.sure)
    return None if row is None else row + int(np.argmax(repeated[row:]))


def _at_limit(sizes: FloatArray, limit: float, sure: int) -> tuple[int, int, int] | None:
    """Return between which rows a limit came into force: after it was passed last, until it was first met exactly."""
    beyond = passing(sizes[:sure], limit)
    low = int(beyond[-1]) + 1 if len(beyond) else 0
    held = meeting(sizes[low:], limit)
    high = low + int(held[0]) if len(held) else 0
    return (low, (low + high) // 2, high) if low and high else None


def _first_of_run(true: BoolArray, row: int) -> int | None:
    """Return where a run began that a row is in; None where it isn't in any."""
    if not true[row]:
        return None
    return row - int(np.argmin(true[row::-1])) + 1 if not true[: row + 1].all() else 0


def _of_spikes(suspect: Suspect, judged: Judgement) -> Onset | None:
    """Return the onset of spikes that come by chance: the time until the first one is exponential."""
    habit, rate_hz = suspect.case.habits.get(suspect.channel), judged.parameters["rate_hz"]
    if habit is None:
        return None
    white = suspect.case.white[own(suspect.channel)][suspect.case.start :][: suspect.judged.stop]
    sizes = np.abs(spikes_in(np.nan_to_num(white), habit.taps))
    rows = np.flatnonzero(sizes > _OF_SPIKE * judged.parameters["size"])
    if not len(rows):
        return None
    first_s = float(suspect.time_s[rows[0]])
    low_s, time_s, high_s = (round(first_s + float(np.log(tail)) / rate_hz, 9) for tail in (TAIL, 0.5, 1.0 - TAIL))
    return Onset(time_s, low_s, high_s)


def _of_walk(suspect: Suspect, gain: float, deviation: float) -> Onset | None:
    """Return the onset of a random walk on a gyro, by the likelihood of its residual's means over blocks.

    With n rows in a block, the covariance of the means of blocks i and j is (i == j) / n + q n min(i - o, j - o) after
    block o, and q = (gain deviation)^2 Ts is the variance of a step as the whitened residual shows it.
    """
    rows = max(round(_BLOCK_S / suspect.case.period_s), 1)
    white = suspect.case.white[suspect.channel][suspect.case.start :][_rows(suspect)]
    blocks = len(white) // rows
    if blocks < 2:
        return None
    means = np.nan_to_num(white[: blocks * rows]).reshape(blocks, rows).mean(axis=1)
    step = np.square(gain * deviation) * suspect.case.period_s * rows
    deviances = []
    for first in range(blocks):
        since = np.maximum(np.arange(blocks) - first + 0.5, 0.0)
        covariance = np.eye(blocks) / rows + step * np.minimum.outer(since, since)
        factor = np.linalg.cholesky(covariance)
        deviances.append(np.square(np.linalg.solve(factor, means)).sum() + 2.0 * np.log(np.diag(factor)).sum())
    low, row, high = (rows * at for at in rows_between(np.array(deviances), _KAPPA_WALK))
    return _between(suspect, low, row + rows // 2, high + rows - 1) if low else None


# ---- what the fault adds ----


def _swapped(one: Suspect, other: Suspect) -> list[tuple[Suspect, Added]]:
    """Return what changes of two sensors that have changed places."""
    off = np.nan_to_num(one.measured - other.measured)
    return [(one, _since(off)), (other, _since(-off))]


def _added(suspect: Suspect, judged: Judgement) -> Added | None:
    """Return what gives the change of the readings by its onset's row; None of a fault that reads anything."""
    figures: dict[str, Any] = {name: value for name, value in judged.parameters.items() if name != "onset_s"}
    how, cls = how_of(judged.kind), loaded_faults().get(str(judged.kind))
    if how == "tone":
        return _since(_tone(suspect, figures["frequency_hz"]))
    if cls is None or how not in _SHAPED or judged.kind == RateSaturation.kind:  # which needs its own past readings
        return None
    if judged.partner is not None:
        figures |= {each.name: judged.partner for each in cls.parameters() if each.is_channel}
    fault = cls(channel=suspect.channel, onset_s=0.0, **figures)
    return lambda row: _distorted(suspect, fault, row)


def _since(change: FloatArray) -> Added:
    """Return a change that is there in full from the onset on."""
    rows = np.arange(len(change))
    return lambda row: np.where(rows >= row, change, 0.0)


def _distorted(suspect: Suspect, fault: Fault, row: int) -> FloatArray:
    """Return what a fault changes that begins with a row."""
    virtual, added = suspect.expected, np.zeros(len(suspect.expected))
    elapsed_s = suspect.time_s[row:] - suspect.time_s[row]
    before = suspect.measured[max(row - 1, 0) :][:1]
    record, start = suspect.case.record, suspect.case.start
    beside = [np.nan_to_num(record[name][start:]) for name in fault.reads[1:]]
    readings = np.column_stack([virtual, *beside])[row:]
    reads, _ = fault.distort(readings, elapsed_s, suspect.case.period_s, fault.begin(before))
    added[row:] = reads - virtual[row:]
    return added


def _tone(suspect: Suspect, frequency_hz: float) -> FloatArray:
    """Return the tone of a frequency that explains the rows judged best."""
    phase = 2.0 * np.pi * frequency_hz * (suspect.time_s - suspect.time_s[0])
    waves = np.array([np.sin(phase), np.cos(phase)])
    shown = suspect.shown(waves).reshape(2, -1)
    there = suspect.there.ravel()
    weights = np.linalg.lstsq(shown[:, there].T, suspect.white.ravel()[there], rcond=None)[0]
    return np.asarray(weights @ waves)


# ---- how likely each onset is ----


def _rows(suspect: Suspect) -> slice:
    """Return the rows whose residuals tell of the onset, from the suspect's first on."""
    stop = suspect.sure + round(LATER_S / suspect.case.period_s)
    return slice(0, min(stop, suspect.judged.stop))


def _loudest(suspect: Suspect) -> FloatArray:
    """Return the residual, whitened, of its axis that holds most of the fault.

    An operator that looks ahead shows an input's change early, by half of that on average.
    """
    case = suspect.case
    able = [output for output in suspect.outputs if output in case.residuals.raw]
    able = [output for output in able if output in axis_of(suspect.channel)] or able
    output = max(able, key=lambda output: case.energies[output])
    early = max((path.ahead for path in suspect.paths if path.output == output), default=0) // 2
    early, rows = min(early, case.start), _rows(suspect)
    return case.white[output][case.start - early : case.start + rows.stop - early]


def _loudness(white: FloatArray, sure: int) -> Callable[[list[int]], FloatArray]:
    """Return what gives D of onsets since which samples have a greater variance."""
    squares = np.square(np.clip(np.nan_to_num(white), -MOST, MOST))
    power = max(float(squares[sure:].mean()) if len(squares) > sure else 0.0, _LOUDER)
    before = np.concatenate([[0.0], np.cumsum(squares)])
    left = np.arange(len(squares), -1, -1)
    deviance = before + (before[-1] - before) / power + left * np.log(power)
    return lambda onsets: deviance[onsets]


def _undone(changes: Sequence[tuple[Suspect, Added]]) -> Callable[[list[int]], FloatArray]:
    """Return what gives D of onsets since which sensors read what they shouldn't."""
    case, rows = changes[0][0].case, _rows(changes[0][0])
    entered = dict.fromkeys(output for suspect, _ in changes for output in suspect.outputs)
    white = {output: case.white[output][case.start :][rows] for output in entered if output in case.residuals.raw}

    def deviance(onsets: list[int]) -> FloatArray:
        left = {output: np.tile(values, (len(onsets), 1)) for output, values in white.items()}
        for suspect, added in changes:
            waves = suspect.shown_in(np.array([added(row) for row in onsets]), rows)
            for place, output in enumerate(suspect.outputs):
                if output in left:
                    left[output] -= waves[:, place]
        squares = [np.square(np.clip(np.nan_to_num(each), -MOST, MOST)).sum(axis=1) for each in left.values()]
        return np.asarray(np.sum(squares, axis=0))

    return deviance


def _likeliest(suspect: Suspect, deviance: Callable[[list[int]], FloatArray], first: int, kappa: float) -> Onset | None:
    """Return the median of the onset and its interval: over onsets from a row on, ever closer where they are likely."""
    low, high = first, suspect.sure
    # -2 log likelihood on a grid, then on finer ones where it is near the least, until every likely row is known
    step = max((high - low) // _TRIED, 1)
    known: dict[int, float] = {}
    while True:
        onsets = [row for row in range(low, high + 1, step) if row not in known]
        known |= zip(onsets, deviance(onsets).tolist(), strict=True) if onsets else {}
        if step == 1:
            break
        least = min(known.values())
        likely = [row for row, of in known.items() if of < least + 2.0 * _FLOOR * kappa]
        low, high = max(min(likely) - step, first), min(max(likely) + step, suspect.sure)
        step = min((high - low) // _TRIED, step - 1) if high - low > 2 * _TRIED else 1
    rows = np.arange(low, high + 1)
    tried = np.array(sorted(known))
    # elsewhere it is far above: a line will do
    curve = np.interp(rows, tried, [known[row] for row in tried.tolist()])
    low, row, high = (low + at for at in rows_between(curve, kappa))
    return _between(suspect, low, row, high) if low > first else None
