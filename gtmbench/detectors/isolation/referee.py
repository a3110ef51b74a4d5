"""Air data as referees between a gyro and the angle that it turns: which of the two has to be wrong for them to agree.

Where a gyro and the attitude differ, that alone doesn't tell which is wrong. Air data and accelerometers tell pitch and
yaw rate once more (`q_air`, `r_air`), with neither but through gravity, which tells of bank, too. With the virtual
sensor of the one that is wrong in its place, they agree as well as they did just before the fault; so the other one is
cleared.

How good air data are depends on the air: in turbulence they are tens of times noisier than in calm. So what is usual is
learnt on the same flight, and where nothing agrees (a gust, a vane that fails, another fault) nothing is said.

Which of two readings holds what they differ by: a gyro's, or the attitude's, which tells of the same rate.

What a fault adds to one of two readings p and d comes with that reading and not with the other, whatever its shape. So
where no kind explains their difference e = p - d, its coherence with each of them tells whose it is: the share of e's
power that a linear filter of p explains is

    sum over f of |S_pe|^2 / S_pp  over  sum over f of S_ee,

at the frequencies f where e is far beyond healthy noise. Two things look like their opposite. A fault that takes motion
away, as a jam does, seems to add it to the other reading; therefore the other one must be as strong as the gyro was
before the fault. And an autopilot that flies on the faulty reading moves the aircraft against the fault, until the
faulty reading looks as it did and the right one doesn't; therefore only frequencies count that are beyond autopilots.
Those below make a sensor likelier, and no more.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gtmbench.detectors.bank.bank import Bank
from gtmbench.detectors.bank.calibrated import energy
from gtmbench.detectors.statistics.whitening import Whitener, fit_whitener
from gtmbench.errors import InputError
from gtmbench.method.pseudo_inputs import derived, raw_needs
from gtmbench.values.channels import GYROS, axis_of
from gtmbench.values.record import BoolArray, FloatArray, Record

if TYPE_CHECKING:
    from gtmbench.detectors.isolation.case import Case

VANES = ("alpha", "beta", "tas")
_AIR = {"p": ("r", "r_air"), "q": ("q", "q_air"), "r": ("r", "r_air")}  # of a gyro: what tells of its axis
_BLOCK_S = 0.2  # of which means are taken: what is faster shows in a sensor's own readings, or is a vane's noise
_ORDER = 5  # blocks that a whitening filter looks back
_LEAST = 10  # blocks judged
_LONGEST_S = 20.0  # judged: an angle that gyros carry on drifts
_HEALTHY = 1.5  # times the usual mean square
_CHANCE = 3.0  # deviations that two healthy ones may be apart


@dataclass(frozen=True, kw_only=True, eq=False)
class Referee:
    """What air data say of a gyro and the angle that it turns."""

    gyro: str
    # by suspect: of the rate's difference from air data, with the suspect's virtual sensor in its place
    usual: Mapping[str, Whitener] = field(repr=False)

    def objections(self, record: Record, virtual: Mapping[str, FloatArray], rows: slice) -> dict[str, float]:
        """Return what speaks against gyro or angle, of -2 log likelihood.

        Nothing where air data agree with neither, or no more than chance tells them apart.

        `virtual`, by suspect, shape (rows of the record,): what they should have read. `rows`: that are judged, the
        first 20 s of them at most.
        """
        size = _size(record)
        before = min(_ORDER, rows.start // size)
        longest = round(_LONGEST_S / record.sample_period_s)
        seen = slice(rows.start - before * size, min(rows.stop, rows.start + longest))
        white = {
            name: self.usual[name].whiten(_blocks(difference[seen], size))[before:]
            for name, difference in _differences(record, self.gyro, virtual)
        }
        there = np.isfinite(list(white.values())).all(axis=0)
        count = int(there.sum())
        energies = {name: energy(each[there]) for name, each in white.items()}
        agreeing, other = sorted(energies, key=energies.__getitem__)
        if count < _LEAST or energies[agreeing] > _HEALTHY * count:
            return {}
        apart = energies[other] - energies[agreeing] - _CHANCE * float(np.sqrt(4.0 * count))
        return {other: apart} if apart > 0.0 else {}


def referees_of(bank: Bank, record: Record, predicted: Mapping[str, FloatArray]) -> dict[str, Referee]:
    """Learn what is usual from rows before a fault, of each gyro that a bank may confuse with its angle.

    Air data that the bank stands on itself tell nothing new.

    `record`: with air data, or without. `predicted`, by output, shape (rows,): the gyros' virtual sensors.
    """
    referees = {}
    for gyro in () if set(VANES) & set(bank.channels) else _AIR:
        is_open = gyro in predicted and set(axis_of(gyro)) <= set(bank.suspects)
        if is_open and _size(record) and raw_needs(_AIR[gyro][1]) <= set(record.channels):
            with suppress(InputError):  # too few rows, or nothing moves
                usual = {
                    name: fit_whitener([_blocks(difference, _size(record))], order=_ORDER)
                    for name, difference in _differences(record, gyro, predicted)
                }
                referees[gyro] = Referee(gyro=gyro, usual=usual)
    return referees


def _differences(record: Record, gyro: str, virtual: Mapping[str, FloatArray]) -> Iterator[tuple[str, FloatArray]]:
    """Give a rate's difference from air data, with virtual sensors in the place of gyro and angle in turn."""
    rate, air = _AIR[gyro]
    needs = raw_needs(air)
    for name in axis_of(gyro):
        stand_in = virtual.get(name, record[name])
        said = derived(record.replace(name, stand_in) if name in needs else record, [air])[0]
        yield name, (stand_in if name == rate else record[rate]) - said


def _size(record: Record) -> int:
    """Return how many rows a block has; none, where a row is longer."""
    return int(_BLOCK_S / record.sample_period_s + 0.5)


def _blocks(values: FloatArray, size: int) -> FloatArray:
    """Return means of rows laid end to end."""
    return np.asarray(values[: len(values) // size * size].reshape(-1, size).mean(axis=1))


_SEGMENT_S = 2.56  # 256 samples at 100 Hz: a power of two
_FEWEST = 6  # segments, which overlap by half
_BEYOND = 4.0  # times the healthy residual's power: a fault is there
_WITH, _WITHOUT = 0.5, 0.3  # shares of e: the least of whose it is, the most of the other
_STRONGER, _LEANING = 2.5, 1.5  # times the other's power where e is: to be clear, to be likely
_AS_BEFORE, _STEADY = 2.0, 1.5  # times by which the other's power there differs from the gyro's before the fault
_BEYOND_AUTOPILOTS_HZ = 3.0  # above it no loop moves the aircraft
_LEAKED = 1e-3  # of the strongest frequency: a window leaks as much into others
_NOTHING = 1e-300  # a logarithm's guard


class Excess(NamedTuple):
    """Whose the difference of two readings is."""

    holder: str  # the sensor that is likelier to hold it
    is_clear: bool  # whether it must be that one


def whose_excess(case: Case, channel: str) -> Excess | None:
    """Return which sensor of a channel's axis holds what its two readings differ by; None where that is open."""
    gyro, *angles = axis_of(channel)
    habit = case.habits.get(gyro)
    if gyro not in GYROS or not angles or gyro not in case.residuals.raw or habit is None or case.driving:
        return None
    span = max(2 * round(0.5 * _SEGMENT_S / case.period_s), 8)
    readings = case.record[gyro][case.judged]
    predicted = readings - (case.residuals.raw[gyro][case.judged] - case.shift[gyro])
    turns = np.arange(2, span // 2 + 1) / span
    healthy = case.monitor.whiteners[gyro].power(2.0 * np.pi * turns)
    found = held_by(readings, predicted, habit.before, healthy, turns / case.period_s > _BEYOND_AUTOPILOTS_HZ)
    return None if found is None else Excess((gyro, angles[0])[found[0]], found[1])


def held_by(
    readings: FloatArray, predicted: FloatArray, before: FloatArray, healthy: FloatArray, fast: BoolArray
) -> tuple[int, bool] | None:
    """Return which of two readings holds what they differ by, 0 or 1, and whether that is clear; None where it is open.

    `readings`, `predicted`, shape (rows,): p and d. `before`, shape (any,): what was read before the fault, in the same
    unit. `healthy`, shape (span // 2 - 1,): the spectrum of p - d without a fault, at the frequencies of a segment of
    `span` rows but the two lowest. `fast`, shape (span // 2 - 1,): which of these are beyond autopilots.

    >>> rng = np.random.default_rng(1)
    >>> motion, added = rng.standard_normal((2, 2000))
    >>> healthy, fast = np.full(127, 0.01), np.arange(127) > 5
    >>> held_by(motion + 3 * added, motion, motion, healthy, fast)
    (0, True)
    >>> held_by(motion, motion + 3 * added, motion, healthy, fast)
    (1, True)
    >>> held_by(motion, 1.5 * motion, motion, healthy, fast)  # likelier that than a gain of the first
    (1, False)
    >>> held_by(motion, 0 * motion, motion, healthy, fast)  # the second is stuck
    """
    span = 2 * (len(healthy) + 1)
    found = _spectra(np.array([readings, predicted, readings - predicted]), span)
    usual = np.square(np.abs(_spectra(before[np.newaxis], span)[0]))
    if found.shape[1] < _FEWEST or not len(usual):
        return None
    # of p, d and p - d by frequency: power, and which share of p - d's each is coherent with
    power = np.square(np.abs(found)).mean(axis=1) + _NOTHING
    coherent = np.square(np.abs((found[:2].conj() * found[2]).mean(axis=1))) / power[:2]
    known = usual.mean(axis=0) + _NOTHING
    loud = power[2] > np.maximum(_BEYOND * healthy, _LEAKED * power[2].max())

    def compared(there: BoolArray) -> tuple[int, FloatArray, list[float]]:
        """Return the stronger reading, shares, and by how much it is stronger, and the other weaker and livelier."""
        weights = power[2, there] / power[2, there].sum()
        levels = np.log(np.array([power[0], power[1], known, known + healthy]))[:, there] @ weights
        holder = int(levels[1] > levels[0])
        other = levels[1 - holder]
        ratios = np.exp([levels[holder] - other, levels[2] - other, other - levels[3]]).tolist()
        return holder, coherent[:, there].sum(axis=1) / power[2, there].sum(), ratios

    # whose spectrum holds all of the difference, while the other's holds none and is as it was: that one reads it.
    # Beyond autopilots that is clear, for no aircraft answers there
    if (loud & fast).any():
        holder, shares, (stronger, weaker, livelier) = compared(loud & fast)
        is_whose = shares[holder] >= _WITH and shares[1 - holder] <= _WITHOUT
        if is_whose and stronger >= _STRONGER and max(weaker, livelier) <= _AS_BEFORE:
            return holder, True
    if loud.any():
        holder, _, (stronger, weaker, _) = compared(loud)
        if stronger >= _LEANING and weaker <= _STEADY:
            return holder, False
    return None


def _spectra(series: FloatArray, span: int) -> np.ndarray[tuple[int, int, int], np.dtype[np.complex128]]:
    """Return the spectra of segments that overlap by half and miss no row: shape (series, segments, span // 2 - 1).

    About their straight lines, by Hann's window, without the two lowest frequencies.
    """
    if series.shape[1] < span:
        return np.zeros((len(series), 0, span // 2 - 1), dtype=complex)
    cut = np.lib.stride_tricks.sliding_window_view(series, span, axis=1)[:, :: span // 2]
    cut = cut[:, np.isfinite(cut).all(axis=(0, 2))]
    place, window = np.linspace(-1.0, 1.0, span), np.hanning(span)
    slope = (cut @ place) / float(place @ place)
    flat = cut - cut.mean(axis=2, keepdims=True) - slope[:, :, np.newaxis] * place
    return np.asarray(np.fft.rfft(flat * window, axis=2)[:, :, 2:] / np.sqrt(np.sum(window**2)))
