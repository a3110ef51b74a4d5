"""What every rival is: a model of healthy records, the residuals that it leaves, and one rule for all that follows.

The rule is the banks': every third record fits the model, the others set the thresholds, for one false-alarm rate of
the whole detector, by the tails of healthy statistics. So a comparison is one of models, not of thresholds.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import Any, ClassVar, Self

import numpy as np

from gtmbench.checks import number, shown
from gtmbench.detectors.bank.calibration import divided
from gtmbench.detectors.gate import gated
from gtmbench.detectors.protocol import Watch
from gtmbench.detectors.rivals.judging import Judge, Judging, Level, judgings
from gtmbench.detectors.rivals.rival_stream import RivalStream
from gtmbench.detectors.rivals.signals import Generator
from gtmbench.detectors.statistics.statistic import Statistic
from gtmbench.detectors.statistics.thresholds import RATE, rate_bound
from gtmbench.detectors.tables import PERIODS_S, keys, table_of
from gtmbench.errors import InputError
from gtmbench.files.plain import exact
from gtmbench.jobs.progress import Progress, silent
from gtmbench.method.problem import taught_records
from gtmbench.values.channels import GYROS
from gtmbench.values.record import FloatArray, Record, frozen

JUDGES: dict[str, Statistic] = {
    "glr": Statistic(),  # likelihood ratios of the whitened residual, as the banks'
    "cusum": Statistic(name="cusum"),
    "level": Level(),  # of what is a distance already
    "sample": Level(windows_s=(0.0,)),
}
_TRIED_S = 20.0  # of which the first two thirds are healthy: baselines want 10 s
_MOST_TRIED = 200_000  # samples: at 10 kHz; a file may say any period
_LONGEST_S = 600.0  # of a window or a memory
_GROSS = 1e4  # deg/s: what no detector may overlook

Model = Mapping[str, FloatArray]


@dataclass(frozen=True, kw_only=True)
class Rival(ABC):
    """A recipe: what it is fitted to, and the residuals of what it was fitted; its fields are its parameters.

    Attributes
    ----------
    name : str
    title : str
        What it is, in a line.
    channels, outputs : tuple of str
        What it reads, and the residuals that it makes of that. The first word of a gyro's residual is the gyro.
    judge : str
        A key of `JUDGES`: what its residuals are judged by.
    settles_s : float
        How long it takes to forget where it began; it says nothing before.
    """

    name: str
    judge: str = "glr"
    settles_s: ClassVar[float] = 0.0

    @property
    @abstractmethod
    def title(self) -> str: ...  # noqa: D102
    @property
    @abstractmethod
    def channels(self) -> tuple[str, ...]: ...  # noqa: D102

    @property
    def outputs(self) -> tuple[str, ...]:
        """The residuals' names; the gyros, unless told."""
        return GYROS

    def fit(self, records: Sequence[FloatArray], sample_period_s: float) -> Model:
        """Return the model of healthy records, each of shape (samples, channels); nothing, unless told."""
        return {}

    @abstractmethod
    def generator(self, model: Model, sample_period_s: float) -> Generator:
        """Return what makes residuals, shape (rows, outputs), of samples, shape (rows, channels)."""

    def calibrate(
        self, records: Sequence[Record], false_alarms_per_hour: float | None = None, *, progress: Progress = silent
    ) -> RivalMonitor:
        """Fit the model on every third record and set thresholds on the others; 40 % and the rest of one.

        Parameters
        ----------
        records : sequence of Record
            Healthy, of one sample period.
        false_alarms_per_hour : float, optional
            Wanted of the whole monitor; 0.002 unless told.
        progress : callable
            Told the step, how many are done, and of how many.

        Raises
        ------
        InputError
            Where channels are missing, or the records are too short or constant.
        """
        rate = number(
            "false_alarms_per_hour", RATE if false_alarms_per_hour is None else false_alarms_per_hour, 1e-9, 1e3
        )
        healthy = [record.select(self.channels) for record in taught_records(records)]
        period_s = healthy[0].sample_period_s
        learn, judged = ([record.values for record in part] for part in divided(healthy))
        progress("fit", 0, 2)
        model = {name: frozen(values) for name, values in self.fit(learn, period_s).items()}
        progress("thresholds", 1, 2)
        made = [[self._residuals(model, values, period_s) for values in part] for part in (learn, judged)]
        learnt, held = ({name: [one[name] for one in part] for name in self.outputs} for part in made)
        self._check_there(held)
        by, luck = judgings(JUDGES[self.judge], learnt, held, period_s, rate)
        progress("done", 2, 2)
        hours = sum(map(len, judged)) * period_s / 3600.0
        provenance = {
            "records": len(healthy),
            "threshold_hours": hours,
            "threshold_spread": luck.table(),
            "false_alarms_per_hour": rate,
            "false_alarms_per_hour_at_most": rate_bound(0, hours),
        }
        monitor = RivalMonitor(rival=self, model=model, judgings=by, sample_period_s=period_s, provenance=provenance)
        peak = monitor.gross_peak(judged[0])
        if peak <= 1.0:
            raise InputError(
                f"'{self.name}' can't promise {rate:g} false alarms an hour: it would be blind, for a gyro that is "
                f"{_GROSS:g} deg/s off takes its score to {peak:.2f} of the threshold at most; ask for a higher rate, "
                f"or give more flights than {len(healthy)}"
            )
        return monitor

    def restore(self, figures: Mapping[str, Any], provenance: Mapping[str, Any] = MappingProxyType({})) -> RivalMonitor:
        """Return the monitor of some figures, with the parameters that it was calibrated with; every key is checked."""
        figures = keys("figures", figures, ("sample_period_s", "name", "recipe", "model", "judgings"))
        period_s = number("sample_period_s", figures["sample_period_s"], *PERIODS_S)
        rival = self._with(keys("recipe", figures["recipe"], tuple(self.recipe())))
        judging = keys("judgings", figures["judgings"], rival.outputs)
        monitor = RivalMonitor(
            rival=rival,
            model={name: _array(f"model.{name}", given) for name, given in table_of("model", figures["model"]).items()},
            judgings={
                name: Judging.of(f"judgings.{name}", judging[name], JUDGES[rival.judge], period_s)
                for name in rival.outputs
            },
            sample_period_s=period_s,
            provenance=dict(provenance),
        )
        monitor.try_out()
        return monitor

    def recipe(self) -> dict[str, Any]:
        """Return its parameters as plain values."""
        return {each.name: exact(getattr(self, each.name)) for each in fields(self)}

    def _with(self, recipe: Mapping[str, Any]) -> Self:
        for key, value in recipe.items():
            own = getattr(self, key)
            if type(value) is not type(own) or (key == "judge" and value not in JUDGES):
                raise InputError(f"recipe.{key} is {shown(value)}; '{self.name}' has {shown(own)} there")
            if key.endswith("_s"):
                number(f"recipe.{key}", value, 0.0, _LONGEST_S)
        return replace(self, **recipe)

    def _residuals(self, model: Model, values: FloatArray, sample_period_s: float) -> dict[str, FloatArray]:
        residuals = self.generator(model, sample_period_s).push(values)
        residuals[: round(self.settles_s / sample_period_s)] = np.nan
        return dict(zip(self.outputs, residuals.T.copy(), strict=True))

    def _check_there(self, residuals: Mapping[str, Sequence[FloatArray]]) -> None:
        for name, parts in residuals.items():
            share = float(np.isfinite(np.concatenate(parts)).mean())
            if share < 0.5:
                raise InputError(
                    f"{100.0 * (1.0 - share):.0f} % of the residual {name} of '{self.name}' is missing; give longer "
                    f"records (it settles in {self.settles_s:g} s), or channels that miss less"
                )


def _array(where: str, given: Any) -> FloatArray:
    """Return nested lists of numbers as an array."""
    try:
        values = np.array(given, dtype=np.float64)
    except (TypeError, ValueError):
        values = np.array(np.nan)
    if not isinstance(given, list) or not np.isfinite(values).all():
        raise InputError(f"{where} is {shown(given)}; it must be lists of numbers, all of one length")
    return frozen(values)


@dataclass(frozen=True, kw_only=True, eq=False)
class RivalMonitor:
    """A rival and what it learnt.

    Attributes
    ----------
    rival : Rival
    model : mapping of str to array
    judgings : mapping of output to Judging
    sample_period_s : float
    """

    rival: Rival
    model: Model = field(repr=False)
    judgings: Mapping[str, Judging] = field(repr=False)
    sample_period_s: float
    provenance: Mapping[str, object] = field(default_factory=dict)

    look_ahead_s: ClassVar[float] = 0.0
    memory_s: ClassVar[float] = float("inf")

    @property
    def name(self) -> str:
        """The rival's."""
        return self.rival.name

    @property
    def channels(self) -> tuple[str, ...]:
        """The rival's."""
        return self.rival.channels

    @property
    def suspects(self) -> tuple[str, ...]:
        """The gyros that have a residual of their own; none for a rival that can't tell which."""
        return tuple(gyro for gyro in GYROS if any(name.split()[0] == gyro for name in self.rival.outputs))

    def generator(self) -> Generator:
        """Return a fresh generator of the residuals."""
        return self.rival.generator(self.model, self.sample_period_s)

    def judges(self) -> dict[str, Judge]:
        """Return a fresh judge of each residual."""
        statistic = JUDGES[self.rival.judge]
        return {name: Judge(statistic, self.judgings[name], self.sample_period_s) for name in self.rival.outputs}

    def stream(self) -> RivalStream:
        """Return a fresh stream; its memory, and time a sample, don't grow."""
        return RivalStream(self, self.generator(), self.judges(), self.sample_period_s, self.rival.settles_s)

    @gated
    def watch(self, record: Record) -> Watch:
        """Return scores and alarms: a stream's, of the record as one chunk.

        Raises
        ------
        InputError
            Where the record lacks a channel or has another sample period.
        """
        return self.stream().taken(record).watch(self, record, self._told_by)

    def _told_by(self, name: str) -> tuple[str, ...]:
        """Return the channels that a score tells of: its gyro, or all."""
        gyro = name.split()[0]
        return (gyro,) if gyro in self.suspects else self.channels

    def figures(self) -> dict[str, object]:
        """Return sample period, parameters, model and thresholds as plain JSON values."""
        return {
            "sample_period_s": self.sample_period_s,
            "name": self.name,
            "recipe": self.rival.recipe(),
            "model": exact(self.model),
            "judgings": {name: judging.table() for name, judging in self.judgings.items()},
        }

    def try_out(self) -> None:
        """Refuse a model that doesn't fit its recipe, or itself, or is blind: of a file that somebody has changed."""
        rows = min(max(round((self.rival.settles_s + _TRIED_S) / self.sample_period_s), 6), _MOST_TRIED)
        try:
            made = self.generator().push(np.zeros((2, len(self.channels))))
            fits = made.shape == (2, len(self.rival.outputs))
            peak = self.gross_peak(np.random.default_rng(1).standard_normal((rows, len(self.channels))))
        except (KeyError, ValueError, IndexError, ZeroDivisionError):
            fits = False
        if not fits:
            raise InputError(f"the model of '{self.name}' doesn't fit its parameters; calibrate anew")
        if peak <= 1.0:
            raise InputError(
                f"'{self.name}' is blind: a gyro that is {_GROSS:g} deg/s off takes its score to {peak:.2g} of the "
                "threshold at most; calibrate anew"
            )

    def gross_peak(self, values: FloatArray) -> float:
        """Return the greatest score over its threshold when a gyro is grossly off, or noisy, on healthy samples.

        Parameters
        ----------
        values : shape (samples, channels)
            The first 20 s after it has settled are used; the last third of them is broken.
        """
        values = values[: round((self.rival.settles_s + _TRIED_S) / self.sample_period_s)]
        since = len(values) - len(values) // 3
        loud = _GROSS * np.random.default_rng(1).standard_normal(len(values) - since)
        peak = 0.0
        for gyro in (self.channels.index(name) for name in GYROS if name in self.channels):
            for error in (_GROSS, loud):
                broken = values.copy()
                broken[since:, gyro] += error
                residuals = self.generator().push(broken)
                scores = [judge.push(residuals[:, i].copy()) for i, judge in enumerate(self.judges().values())]
                peak = max(peak, *(float(np.fmax.reduce(score[since:], initial=0.0)) for score in scores))
                if peak > 1.0:
                    return peak
        return peak
