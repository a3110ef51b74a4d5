"""A case: the rows of a record that an alarm is judged on, and everything that its hypotheses share."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Generic, TypeVar

import numpy as np

from gtmbench.detectors.bank.calibrated import BankResiduals, CalibratedBank, energy, greatest, residuals_of
from gtmbench.detectors.isolation.effects import undriven
from gtmbench.detectors.isolation.own_noise import Habit, steps
from gtmbench.detectors.isolation.referee import VANES, Referee
from gtmbench.detectors.virtual import ANGLES, integrable, integrated_angle
from gtmbench.method.pseudo_inputs import PSEUDO_INPUTS
from gtmbench.values.attitude_estimators import AttitudeEstimator
from gtmbench.values.channels import GYROS, axis_of
from gtmbench.values.record import FloatArray, Record

Value = TypeVar("Value")


class LazyMapping(Mapping[str, Value], Generic[Value]):
    """A mapping whose values are each worked out when first asked for; once, where it `keeps` them.

    `work_out`: gives a name's value.

    >>> squares = LazyMapping(["2", "3", "4"], lambda name: int(name) ** 2)
    >>> squares["3"], "5" in squares, sum(squares.values())
    (9, False, 29)
    """

    def __init__(self, names: Iterable[str], work_out: Callable[[str], Value], *, keeps: bool = True) -> None:
        self._names, self._work_out, self._keeps = dict.fromkeys(names), work_out, keeps
        self._known: dict[str, Value] = {}

    def __getitem__(self, name: str) -> Value:
        if name in self._known:
            return self._known[name]
        if name not in self._names:
            raise KeyError(name)
        value = self._work_out(name)
        if self._keeps:
            self._known[name] = value
        return value

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


ACCELEROMETERS = ("nx", "ny", "nz")
WITNESSES = (*ACCELEROMETERS, *VANES)  # what a diagnosis may read beside the bank's channels, where a record has them
_LEAST = 10  # rows judged
_TELLING_S = 2.0  # of rows judged
_AS_BEFORE = 0.3  # of their steps, by which other sensors still move
_REMEMBERED_S = 0.3  # that matters, by the longer filters of driven attitudes
_SMOOTH_S, _SMOOTH_ORDER = 0.2, 3  # a cubic over so long follows what an aircraft does, and no noise
_REFERRED_S = 1.0  # over which what references say of a gyro is smooth: they are noisier than it is
_FREQUENCIES = 64  # from 0 to half the sample rate


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """Rows of a record that an alarm is judged on."""

    monitor: CalibratedBank
    # from before the onset to the end of the horizon: the bank's channels, and the witnesses that are there
    record: Record
    residuals: BankResiduals = field(repr=False)
    start: int  # the suspect isn't believed from here on: the onset and a margin
    # onset, sure: rows of it: where the fault may have begun as far as the test tells, and from where on it is surely
    # there
    onset: int
    sure: int
    shift: Mapping[str, float]  # means of the residuals before the fault (biases), in the outputs' units
    # whose own readings are weighed: of a sensor that has been ruled out they say the same of every hypothesis
    suspects: tuple[str, ...]
    habits: Mapping[str, Habit]  # how the bank's suspects read before the fault
    referees: Mapping[str, Referee] = field(default_factory=dict)  # of gyros, where there are air data beside them
    source: str = ""  # the residual whose alarm is judged
    others: frozenset[str] = frozenset()  # residuals with an alarm of their own that began at another time
    together: frozenset[str] = frozenset()  # those whose alarm began when this one did, its own among them

    def with_record(self, record: Record) -> Case:
        """Return the case had another record been read."""
        residuals = residuals_of(self.monitor.bank, record, self.monitor.operators, self.residuals.raw)
        return replace(self, record=record, residuals=replace(self.residuals, raw=residuals.raw))

    @property
    def period_s(self) -> float:
        """Ts."""
        return self.record.sample_period_s

    @cached_property
    def driving(self) -> tuple[str, ...]:
        """The suspects that drive the attitude; none where it is of its own."""
        bank = self.monitor.bank
        gyros = GYROS if bank.attitude_from_gyros and {"phi", "theta"} <= set(bank.channels) else ()
        return tuple(gyro for gyro in gyros if gyro in self.residuals.raw and gyro in self.virtual)

    @property
    def end_s(self) -> float:
        """When the last sample of the case is there."""
        return round(float(self.record.time_s[-1]), 9)

    @cached_property
    def judged(self) -> slice:
        """The rows that are judged: the fault is surely there, and filters have forgotten what was before.

        Up to where every residual is known at the case's end.
        """
        monitor = self.monitor
        outputs = tuple(self.residuals.raw)
        most = round(_REMEMBERED_S / self.period_s) if monitor.bank.attitude_from_gyros else len(self.record)
        whiteners = {name: min(monitor.whiteners[name].order, most) for name in outputs}
        memory = max(monitor.operators[name].causal_order + whiteners[name] for name in outputs) + 1
        ahead = max(round(monitor.look_ahead_of(name) / self.period_s) for name in outputs)
        stop = max(len(self.record) - ahead, 0)
        return slice(min(self.sure + memory, stop), stop)

    @property
    def is_ripe(self) -> bool:
        """Whether there are rows enough to judge on."""
        return bool(self.judged.stop - self.judged.start >= _LEAST)

    @property
    def is_telling(self) -> bool:
        """Whether there are rows enough to name or rule out a sensor whatever its fault is."""
        return bool((self.judged.stop - self.judged.start) * self.period_s >= _TELLING_S)

    @cached_property
    def white(self) -> Mapping[str, FloatArray]:
        """Residuals, whitened about their means before the fault, and sensors' own innovations; row for row."""
        return LazyMapping((*self.residuals.raw, *self._innovations), self._whitened)

    def _whitened(self, name: str) -> FloatArray:
        if name in self._innovations:
            return self._innovations[name] / self.spread(name)
        values = self.monitor.whiteners[name].whiten(self.residuals.raw[name] - self.shift[name])
        return np.asarray(values / self.spread(name))

    @cached_property
    def _innovations(self) -> Mapping[str, FloatArray]:
        """Sensors' own, however they move."""
        channels = {own(channel): channel for channel in self.habits}
        return LazyMapping(channels, lambda name: self.habits[channels[name]].innovations(self.record[channels[name]]))

    @cached_property
    def energies(self) -> dict[str, float]:
        """-2 log likelihood of each whitened residual over the rows judged, were it healthy."""
        weighed = (*self.residuals.raw, *(own(channel) for channel in self.suspects if channel in self.habits))
        return {output: energy(self.white[output][self.judged]) for output in weighed}

    @cached_property
    def surprises(self) -> dict[str, float]:
        """-2 log likelihood of how often each suspect's readings run dead straight since the fault is surely there.

        No filter has to forget what was before, so that more rows tell than are judged. Counts tell it only where the
        aircraft still moves: on the ground all of them stand still.
        """
        return {
            channel: self.habits[channel].surprise(self.record[channel][self._surely])
            if self.is_told_by_lines(channel)
            else 0.0
            for channel in self.suspects
            if channel in self.habits
        }

    def is_told_by_lines(self, channel: str) -> bool:
        """Tell whether dead straight readings say something: they are no counts, or others of their kind still move."""
        if channel not in self.habits or not self.habits[channel].is_counted:
            return True
        others = [name for name in (ANGLES if channel in ANGLES else GYROS) if name != channel and name in self.habits]
        return bool(others) and all(map(self.moves, others))

    def moves(self, channel: str) -> bool:
        """Tell whether a sensor's readings still move about as they did before."""
        return steps(self.record[channel][self._surely]) >= _AS_BEFORE * steps(self.habits[channel].before)

    @property
    def _surely(self) -> slice:
        """The rows since the fault is surely there, up to the last one judged."""
        return slice(self.sure, self.judged.stop)

    def objection(self, suspect: str) -> float:
        """Return what air data say against a suspect that they clear, of -2 log likelihood; 0 otherwise."""
        gyro = axis_of(suspect)[0]
        return self._objections[gyro].get(suspect, 0.0) if gyro in self._objections else 0.0

    def _refereed(self, gyro: str) -> dict[str, float]:
        referee, axis = self.referees[gyro], axis_of(gyro)
        predicted = self.residuals.predicted  # a gyro's with its bias, as it was learnt
        if self.monitor.bank.attitude_from_gyros:  # what predicts the gyros has bent with them
            return {}
        if not all(name in predicted or name in self.virtual for name in axis):
            return {}
        virtual = {name: predicted[name] if name in predicted else self.virtual[name] for name in axis}
        return referee.objections(self.record, virtual, self.judged)

    @cached_property
    def _objections(self) -> Mapping[str, dict[str, float]]:
        """By the gyros of their axes."""
        return LazyMapping(self.referees, self._refereed)

    @property
    def deviance(self) -> float:
        """-2 log likelihood of the case were all sensors healthy."""
        return sum(self.energies.values()) + sum(self.surprises.values())

    @property
    def count(self) -> int:
        """How many samples of whitened residuals are judged."""
        residuals = (self.white[output] for output in self.residuals.raw)
        return sum(int(np.isfinite(of[self.judged]).sum()) for of in (*residuals, *self._innovations.values()))

    @cached_property
    def sickness(self) -> dict[str, float]:
        """How far each residual gets towards its thresholds over the rows judged, as it is; healthy up to 1."""
        judged = self.judged
        return {output: greatest(self.monitor, output, self.white[output][judged]) for output in self.residuals.raw}

    def spread(self, output: str) -> FloatArray | float:
        """Return what a whitened residual is divided by: its operator's uncertainty; of a sensor's own, motion."""
        if output in self.residuals.spread:
            return self.residuals.spread[output].white
        return self._motion.get(output, 1.0)

    @cached_property
    def _motion(self) -> Mapping[str, FloatArray]:
        channels = {own(channel): channel for channel in self.expected}
        return LazyMapping(channels, lambda name: self.habits[channels[name]].motion(self.expected[channels[name]]))

    @cached_property
    def virtual(self) -> Mapping[str, FloatArray]:
        """What each suspect should have read, over the whole case; those that nothing predicts aren't there."""
        bank, predicted = self.monitor.bank, self.residuals.predicted
        names = [name for name in bank.suspects if name in predicted or integrable(name, bank.channels)]
        return LazyMapping(names, self._predicted)

    def _predicted(self, name: str) -> FloatArray:
        if name in self.residuals.predicted:
            return np.asarray(self.residuals.predicted[name] + self.shift[name] + self._mean(name))
        return integrated_angle(self._unbiased, name, self.start)

    @cached_property
    def expected(self) -> Mapping[str, FloatArray]:
        """The same without the virtual sensors' noise, which no fault passes on, of suspects with a habit.

        What they read, where it isn't known what they should have.
        """
        return LazyMapping((name for name in self.virtual if name in self.habits), self._expected)

    def _expected(self, name: str) -> FloatArray:
        virtual, window = self.virtual[name], self._window
        unknown = ~np.isfinite(virtual)
        values = np.where(unknown, np.nan_to_num(self.record[name]), virtual)
        if not window:
            return values
        near = np.convolve(unknown, np.ones(window), mode="same") > 0.5 if unknown.any() else unknown
        return np.where(near, values, self.smooth(values))

    def smooth(self, values: FloatArray) -> FloatArray:
        """Return rows without most of their noise."""
        return _smooth(values, _cubics(self._window)) if self._window else values

    def referred(self, values: FloatArray) -> FloatArray:
        """Return rows without the noise of an estimator's references."""
        window = min(2 * int(0.5 * _REFERRED_S / self.period_s) + 1, (len(values) - 1) // 2 * 2 + 1)
        known = np.nan_to_num(values)
        return _smooth(known, _cubics(window)) if window >= 5 else known

    def undriven(self, channel: str, estimator: AttitudeEstimator) -> FloatArray:
        """Return what a gyro that drives the attitude should have read, by the references of the estimator."""
        residual = self.residuals.raw[channel] - self.shift[channel] - self._mean(channel)
        off = undriven(estimator, self.referred(residual), self.period_s)
        return np.asarray(self.record[channel] - self.referred(off))  # slopes are noisier than what they are of

    @cached_property
    def smoothing(self) -> FloatArray:
        """What of each frequency, evenly from 0 to half the sample rate, `expected` keeps."""
        window = self._window
        if not window:
            return np.ones(1)
        frequency = np.linspace(0.0, np.pi, _FREQUENCIES)
        return np.asarray(np.cos(np.outer(frequency, _places(window))) @ _cubics(window)[window // 2])

    @property
    def _window(self) -> int:
        """Rows over which `expected` is smooth; 0 where there are too few."""
        window = 2 * int(0.5 * _SMOOTH_S / self.period_s) + 1
        return window if 5 <= window <= len(self.record) else 0

    @cached_property
    def _unbiased(self) -> Record:
        """The record, its gyros without the biases that they had before the fault."""
        record = self.record
        for spec in self.monitor.bank.diagnostic:
            # kinematics alone: the mean of the residual is the gyro's bias
            is_kinematic = len(spec.inputs) == 1 and spec.inputs[0] in PSEUDO_INPUTS
            if is_kinematic and spec.output in self.residuals.raw:
                bias = self.shift[spec.output] + self._mean(spec.output)
                record = record.replace(spec.output, record[spec.output] - bias)
        return record

    def _mean(self, output: str) -> float:
        return self.monitor.whiteners[output].mean


def _places(window: int) -> FloatArray:
    return np.arange(window, dtype=np.float64) - 0.5 * (window - 1)


@lru_cache(maxsize=8)
def _cubics(window: int) -> FloatArray:
    """Return what makes of rows the cubic nearest to them, shape (window, window): Savitzky's and Golay's."""
    powers = np.vander(_places(window) / window, _SMOOTH_ORDER + 1)
    return np.asarray(powers @ np.linalg.pinv(powers))


def _smooth(values: FloatArray, cubics: FloatArray) -> FloatArray:
    """Return rows as the cubics around them have them: at the ends, as the first and the last one have."""
    window, half = len(cubics), len(cubics) // 2
    middle = np.convolve(values, cubics[half], mode="valid")
    return np.concatenate([cubics[:half] @ values[:window], middle, cubics[half + 1 :] @ values[-window:]])


def own(channel: str) -> str:
    """Return the name that a channel's innovations have among the whitened residuals."""
    return f"own {channel}"


def shift_of(monitor: CalibratedBank, output: str, before: FloatArray) -> float:
    """Return the mean of a residual before a fault, about that of its identification."""
    there = before[np.isfinite(before)]
    return float(there.mean()) - monitor.whiteners[output].mean if len(there) else 0.0
