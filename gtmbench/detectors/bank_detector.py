"""Banks as detectors: a recipe that healthy records calibrate, and the monitor that it becomes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from gtmbench.detectors.assumptions import Basis
from gtmbench.detectors.bank.bank import Bank, load_bank
from gtmbench.detectors.bank.calibrated import CalibratedBank, residuals_of, without_spread
from gtmbench.detectors.bank.calibration import calibrate_bank
from gtmbench.detectors.bank.composed import AUTO, composed_bank
from gtmbench.detectors.bank.parsing import bank_figures, calibrated_of
from gtmbench.detectors.excursion import Excursion
from gtmbench.detectors.gate import gated
from gtmbench.detectors.isolation.case import WITNESSES
from gtmbench.detectors.monitor.bank_stream import BankStream, BegunWatch, RecordStream
from gtmbench.detectors.monitor.bank_trials import BankTrials
from gtmbench.detectors.monitor.excursions import Excursions, blots, blotted, rises_of
from gtmbench.detectors.monitor.motion_stream import MotionStream
from gtmbench.detectors.monitor.open_faults import Arming
from gtmbench.detectors.monitor.regime import LATE_S, Regime
from gtmbench.detectors.monitor.residuals import RecordResiduals
from gtmbench.detectors.monitor.superposition import ChangedResidual, Superposition
from gtmbench.detectors.protocol import Score, Watch
from gtmbench.detectors.statistics.statistic import Spread
from gtmbench.detectors.statistics.thresholds import RATE
from gtmbench.errors import InputError
from gtmbench.jobs.progress import Progress, silent
from gtmbench.method.estimators.bayesian import Bayesian
from gtmbench.method.problem import Estimator, Records, as_records, taught_records
from gtmbench.values.channels import unit_of
from gtmbench.values.clock import even_times_s
from gtmbench.values.notebook import card, figure
from gtmbench.values.record import BoolArray, FloatArray, Record, sealed

_RATE_OF_ENERGY = 1.0  # of a flight by a bank that judges energy


@dataclass(frozen=True, kw_only=True, eq=False)
class BankWatch(Watch):
    """Everything that a bank said of a record.

    Attributes
    ----------
    spread : mapping of output to Spread
        How far residuals may be off, as the statistics take it; empty where nothing is uncertain.
    before : mapping of output to array
        Healthy residuals on which the noise was learnt before the record began; empty where it was learnt on it.
    """

    spread: Mapping[str, Spread] = field(repr=False)
    before: Mapping[str, FloatArray] = field(default_factory=lambda: MappingProxyType({}), repr=False)


@dataclass(frozen=True, kw_only=True, eq=False)
class BankMonitor(CalibratedBank):
    """A calibrated bank; a residual's score is the greatest of its test statistics over their thresholds.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> noise = np.random.default_rng(1).standard_normal((6000, 2))
    >>> record = gb.Record(noise @ [[1.0, 1.0], [0.0, 0.1]], channels=["p", "q"], sample_period_s=0.04)
    >>> monitor = gb.calibrate(record.between(0, 120), bank=gb.bank_between(["p"], ["q"]), false_alarms_per_hour=1.0)
    >>> broken = gb.inject(record.between(120, 239), gb.Noise(channel="q", onset_s=180.0, deviation=2.0))
    >>> alarm = monitor.watch(broken).faults[0]
    >>> alarm.source, 180.0 < alarm.time_s < 182.0
    ('q', True)
    """

    @property
    def name(self) -> str:
        """The bank's."""
        return self.bank.name

    @property
    def channels(self) -> tuple[str, ...]:
        """The measured channels that the bank needs."""
        return self.bank.channels

    @property
    def suspects(self) -> tuple[str, ...]:
        """The sensors that it may name."""
        return self.bank.suspects

    @property
    def basis(self) -> Basis:
        """What it rests on beside its channels."""
        rows = self.bank.statistic.looks_back(self.sample_period_s)
        return replace(_basis(self.bank), is_cautious=self.is_cautious, looks_back_s=rows * self.sample_period_s)

    @property
    def look_ahead_s(self) -> float:
        """The latency of its last residual, in seconds after a sample."""
        return max(map(self.look_ahead_of, self.operators))

    def _repr_html_(self) -> str:
        known: Mapping[str, Any] = self.provenance
        asked, shown = (known.get(f"false_alarms_per_hour{end}") for end in ("", "_at_most"))
        facts = {
            "may name": ", ".join(self.suspects),
            "look-ahead": f"{self.look_ahead_s:g} s, samples every {self.sample_period_s:g} s",
            "false alarms an hour": f"{figure(asked)} asked for; at most {figure(shown)} shown at 95 %",
        }
        rows = [
            (name, ", ".join(each.inputs), f"{figure(float(each.rms_residual[0]))} {unit_of(name)}".rstrip())
            for name, each in self.operators.items()
        ]
        return card(f"Monitor: bank {self.name}", facts, columns=("residual of", "told from", "RMS"), rows=rows)

    @property
    def memory_s(self) -> float:
        """Infinite, because a lasting fault is remembered for as long as it lasts."""
        return float("inf")

    def stream(self) -> BankStream:
        """Return a fresh stream, which gives the results of `watch` as samples arrive."""
        regime = Regime.from_provenance(self.provenance)
        return MotionStream(self, regime) if self.bank.kinematic and regime.limits else BankStream(self)

    def trials(self, record: Record) -> BankTrials:
        """Return whether and when faults alarm on a healthy record, without watching each broken record."""
        return BankTrials(self, self, record)

    def begun(self, watch: BankWatch) -> BegunWatch:
        """Return what is known of records that begin as a watched one does."""
        record, residuals = watch.record, RecordResiduals(self, watch.record)
        none = Excursions(self, record.start_s, (), [], record.end_s - LATE_S)
        return BegunWatch(record, lambda: RecordStream(residuals, [], excursions=none))

    @gated
    def watch(
        self,
        record: Record,
        *,
        without: Iterable[str] = (),
        outside: Sequence[Excursion] = (),
        before: Record | None = None,
        begun: BegunWatch | None = None,
        progress: Progress = silent,
    ) -> BankWatch:
        """Watch a record: every alarm is diagnosed, then watching goes on with the residuals that can still be trusted.

        A stream does the same with rows as they arrive.

        Parameters
        ----------
        record : Record
        without : iterable of str
            Families of hypotheses that diagnoses leave out (`isolation.hypotheses.families`), to test faults without a
            hypothesis.
        outside : sequence of Excursion
            Stretches without evidence: an alarm in one gives "can't tell".
        before : Record, optional
            A healthy record of the same sensors. Their noise is learnt on its last 20 s, so watching begins at once.
        begun : BegunWatch, optional
            Of `begun`, where the record begins as that does: takes the place of all others but `progress`.
        progress : callable
            Called with ``watch``, the rows done and the total.

        Raises
        ------
        InputError
            If the record lacks a channel of the bank or has another sample period.
        """
        # 1. what each residual is, and which samples an excursion leaves out
        residuals = RecordResiduals(self, record)
        out = blots(self, record, outside)
        learnt = {} if before is None else dict(without_spread(self, before).raw)
        # 2. what scores would have said inside of what nobody judges: it is told as an alarm that can't be judged
        is_silent = any(not excursion.is_judged for excursion in outside)
        rises = rises_of(residuals, learnt) if is_silent else []
        excursions = Excursions(self, record.start_s, outside, rises, record.end_s - LATE_S)
        # 3. the record as a stream takes it: scores, alarms, judgements
        stream = None if begun is None else begun.stream(residuals)
        if stream is None:
            stream = RecordStream(residuals, out, before=learnt, without=without, excursions=excursions)
        stream.take_all(progress)
        return BankWatch(
            monitor=self,
            record=record,
            scores=MappingProxyType(
                {each.output: _score(self, record, each, stream.scores[each.output]) for each in stream.armings}
            ),
            alarms=stream.alarms,
            residuals=residuals.raw,
            predictions=residuals.predicted,
            spread=residuals.spread,
            before=MappingProxyType(learnt),
            outside=tuple(outside),
            noise_levels=MappingProxyType(stream.noise_levels),
            widening=MappingProxyType(stream.widening),
        )

    def residual(self, record: Record, sensor: str) -> FloatArray:
        """Return e(k) of a sensor, shape (samples,), NaN where it isn't known."""
        return residuals_of(self.bank, record, self.operators, [sensor]).raw[sensor]

    def superposition(self, watch: Watch, sensor: str) -> Superposition:
        """Return the effect of a sensor's faults on its own residual's test statistic, on a watched record."""
        assert isinstance(watch, BankWatch)
        out = [each for each in blots(self, watch.record, watch.outside) if each[0] == sensor]
        raw = blotted({sensor: watch.residuals[sensor]}, out)[sensor]
        spread, before = watch.spread.get(sensor), watch.before.get(sensor)
        return Superposition(
            sensor=sensor,
            record=watch.record,
            residual=ChangedResidual(monitor=self, output=sensor, raw=raw, spread=spread, before=before),
            armed=watch.scores[sensor].armed,
        )

    def figures(self) -> dict[str, object]:
        """Return the calibration's results, with the bank's tables, as plain JSON values."""
        return bank_figures(self)


def _basis(bank: Bank) -> Basis:
    return Basis(
        title=f"bank {bank.name}",
        witnesses=WITNESSES,
        predicts=tuple(spec.output for spec in bank.diagnostic),
        kinematic=bank.kinematic,
        attitude_from_gyros=bank.attitude_from_gyros if bank.predicts_gyros_from_attitude else None,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class BankScore(Score):
    """A residual's score, known so many rows after its own: when that is, is worked out for who asks."""

    known_s: FloatArray = field(init=False, repr=False)
    start_s: float
    sample_period_s: float
    ahead: int

    def __getattr__(self, name: str) -> FloatArray:
        if name != "known_s":
            raise AttributeError(name)
        known_s = even_times_s(self.start_s, self.sample_period_s, range(len(self.values)))
        known_s += self.ahead * self.sample_period_s
        return sealed(np.round(known_s, 9, out=known_s))


def _score(monitor: CalibratedBank, record: Record, arming: Arming, values: FloatArray) -> Score:
    since = arming.disarmed_row
    return BankScore(
        name=arming.output,
        values=sealed(values),
        start_s=record.start_s,
        sample_period_s=record.sample_period_s,
        ahead=arming.track.ahead,
        channels=tuple(name for name in monitor.bank.channels if arming.source in monitor.bank.affects(name)),
        armed=np.isfinite(values) & _armed(arming, len(record)),
        tests=monitor.thresholds[arming.output],
        disarmed_s=None if since is None else record.time_at(since),
    )


def _armed(arming: Arming, rows: int) -> BoolArray:
    """Return whether a row's score, once known, could have raised an alarm."""
    armed = np.zeros(rows + arming.track.ahead, dtype=bool)  # when it is known
    for row, able in arming.changes or ():
        armed[row:] = able
    return armed[arming.track.ahead :]


@dataclass(frozen=True, kw_only=True)
class BankDetector:
    """A bank as a recipe.

    Parameters
    ----------
    bank : Bank

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> noise = np.random.default_rng(1).standard_normal((3000, 2))
    >>> healthy = gb.Record(noise @ [[1.0, 1.0], [0.0, 0.1]], channels=["p", "q"], sample_period_s=0.04)
    >>> detector = gb.BankDetector(bank=gb.bank_between(["p"], ["q"]))
    >>> detector.channels
    ('q', 'p')
    >>> detector.calibrate([healthy], 1.0).suspects  # at most one false alarm an hour is wanted
    ('q', 'p')
    """

    bank: Bank

    @property
    def name(self) -> str:
        """The bank's."""
        return self.bank.name

    @property
    def channels(self) -> tuple[str, ...]:
        """The measured channels that it needs."""
        return self.bank.channels

    @property
    def basis(self) -> Basis:
        """What it rests on beside its channels."""
        return _basis(self.bank)

    def for_attitude(self, *, is_driven: bool) -> BankDetector:
        """Return the bank for an attitude that the gyros drive, or for an independent one."""
        if self.bank.attitude_from_gyros == is_driven:
            return self
        return replace(self, bank=self.bank.driven() if is_driven else replace(self.bank, attitude_from_gyros=False))

    def calibrate_on_flight(
        self,
        records: Sequence[Record],
        false_alarms_per_hour: float | None = None,
        *,
        provenance: Mapping[str, object] = MappingProxyType({}),
        progress: Progress = silent,
    ) -> BankMonitor:
        """Identify the bank on stretches of a flight, always with caution: one flight excites few directions.

        The default is 0.002 false alarms an hour, or 1 for a bank that judges energy.
        """
        usual = _RATE_OF_ENERGY if self.bank.statistic.name == "energy" else RATE
        return calibrate(
            records,
            bank=self.bank,
            false_alarms_per_hour=usual if false_alarms_per_hour is None else false_alarms_per_hour,
            estimator=Bayesian(),
            provenance=provenance,
            progress=progress,
        )

    def calibrate(
        self, records: Sequence[Record], false_alarms_per_hour: float | None = None, *, progress: Progress = silent
    ) -> BankMonitor:
        """Identify the bank and set its thresholds for a false alarm rate, by default 0.002 an hour."""
        return calibrate(records, bank=self.bank, false_alarms_per_hour=false_alarms_per_hour, progress=progress)

    def restore(self, figures: Mapping[str, Any], provenance: Mapping[str, Any] = MappingProxyType({})) -> BankMonitor:
        """Return the monitor of some figures; they have to be of this bank."""
        monitor = restore_bank(figures, provenance)
        if monitor.bank != self.bank:
            raise InputError(
                f"the figures are of bank {monitor.name}, whose tables aren't those of bank {self.name}; give the "
                "monitor's file alone, or calibrate anew"
            )
        return monitor


def restore_bank(figures: Mapping[str, Any], provenance: Mapping[str, Any]) -> BankMonitor:
    """Return the monitor of a bank, whichever its figures hold; every key is checked.

    InputError naming the key, what stands there and what should.
    """
    return BankMonitor(**vars(calibrated_of(figures, provenance)))


def calibrate(
    records: Records,
    *,
    bank: Bank | str | Path,
    false_alarms_per_hour: float | None = None,
    estimator: Estimator | None = None,
    provenance: Mapping[str, object] | None = None,
    progress: Progress = silent,
) -> BankMonitor:
    """Identify a bank on healthy records and set its thresholds, as `calibrate_bank` does.

    Parameters
    ----------
    records : Record or sequence of Record
        Healthy measurements with the bank's channels, all of one sample period.
    bank : Bank, str or Path
        A bank, a name such as ``C``, or a TOML file.
    false_alarms_per_hour : float, optional
        Rate to calibrate the whole monitor for (by default 0.002); far below 1 over the hours given, it rests on
        extrapolated tails.
    estimator : Estimator, optional
        By default `LeastSquares` for five minutes in all and more, `Bayesian` for less.
    provenance : mapping, optional
        The origin of the records, kept with the monitor.
    progress : callable
        Called with the step, the number done and the total.

    Raises
    ------
    InputError
        If channels are missing or constant, or the records too short.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> noise = np.random.default_rng(1).standard_normal((3000, 2))
    >>> healthy = gb.Record(noise @ [[1.0, 1.0], [0.0, 0.1]], channels=["p", "q"], sample_period_s=0.04)
    >>> monitor = gb.calibrate(healthy, bank=gb.bank_between(["p"], ["q"]), false_alarms_per_hour=1.0)
    >>> monitor.operators["q"].name, monitor.watch(healthy).faults
    ('[p] -> q', ())
    """
    calibrated = calibrate_bank(
        taught_records(records),
        bank if isinstance(bank, Bank) else load_bank(bank),
        false_alarms_per_hour=RATE if false_alarms_per_hour is None else false_alarms_per_hour,
        estimator=estimator,
        provenance=provenance,
        progress=progress,
    )
    return BankMonitor(**vars(calibrated))


@dataclass(frozen=True, kw_only=True)
class AutoDetector:
    """Bank auto as a recipe: a log's or a record's channels make it a bank (`composed_bank`)."""

    name: str = AUTO
    channels: tuple[str, ...] = ()  # whatever is there

    def calibrate(
        self, records: Sequence[Record], false_alarms_per_hour: float | None = None, *, progress: Progress = silent
    ) -> BankMonitor:
        """Identify the bank that the channels of all records allow, and set its thresholds."""
        given = as_records(records)
        first, *others = (set(record.channels) for record in given)
        bank = composed_bank(first.intersection(*others))
        return BankDetector(bank=bank).calibrate(given, false_alarms_per_hour, progress=progress)

    def restore(self, figures: Mapping[str, Any], provenance: Mapping[str, Any] = MappingProxyType({})) -> BankMonitor:
        """Return the monitor of some figures, whichever bank it was."""
        return restore_bank(figures, provenance)
