"""Rows that keep everybody honest: what knows nothing, and what knows all."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gtmbench.detectors.base import SimpleDetector
from gtmbench.files.writing import atomic_write, make_folder
from gtmbench.study.benchmark.definition import Definition, Flight
from gtmbench.study.benchmark.entry import ALARMS, ENTRY
from gtmbench.study.benchmark.flights import Told
from gtmbench.values.channels import GYROS
from gtmbench.values.record import FloatArray, Record

Times = list[tuple[float, str]]  # seconds, and the sensor that is named
_EVERY_S = 10.0


def _never(_flight: Flight, _definition: Definition, _told: Told | None) -> Times:
    return []


def _always(flight: Flight, _definition: Definition, _told: Told | None) -> Times:
    return [(float(time_s), "") for time_s in np.arange(0.0, flight.end_s, _EVERY_S)]


def _random(flight: Flight, definition: Definition, _told: Told | None) -> Times:
    """Alarms of a Poisson process, which a flight that is cut short has up to its end."""
    draw = np.random.default_rng([flight.seed, 4])
    count = draw.poisson(definition.false_alarms_per_hour * definition.duration_s / 3600.0)
    times_s = sorted(draw.uniform(0.0, definition.duration_s, count).tolist())
    return [(time_s, str(draw.choice(GYROS))) for time_s in times_s if time_s <= flight.end_s]


def _oracle(flight: Flight, _definition: Definition, _told: Told | None) -> Times:
    return [(each.onset_s, each.channel) for each in flight.faults if each.onset_s <= flight.end_s]


def _reference(flight: Flight, _definition: Definition, told: Told | None) -> Times:
    if told is None:
        return []
    times_s = [*told.false_s, *([flight.onset_s + told.delay_s] if np.isfinite(told.delay_s) else [])]
    return [(time_s, flight.faults[0].channel) for time_s in times_s if time_s <= flight.end_s]


@dataclass(frozen=True, kw_only=True)
class Yardstick:
    """A row that isn't a detector: its title, and the alarms that it raises on a flight."""

    title: str
    alarms: Callable[[Flight, Definition, Told | None], Times]


YARDSTICKS = {
    "reference": Yardstick(title="CUSUM that knows the fault, its shape and the noise", alarms=_reference),
    "oracle": Yardstick(title="knows the onset", alarms=_oracle),
    "random": Yardstick(title="alarms at the allowed rate, at random", alarms=_random),
    "never": Yardstick(title="never an alarm", alarms=_never),
    "always": Yardstick(title="an alarm in ten seconds", alarms=_always),
}


def write_yardsticks(folder: Path, definition: Definition, split: str, reference: Mapping[str, Told]) -> list[Path]:
    """Write the entries of all yardsticks, a folder each, and return these."""
    flights = list(definition.flights(split))
    written = []
    for name, yardstick in YARDSTICKS.items():
        own = folder / name
        make_folder(own)
        lines = ["flight,time_s,sensor"]
        for flight in flights:
            alarms = yardstick.alarms(flight, definition, reference.get(flight.twin or flight.id))
            lines += [f"{flight.id},{time_s!r},{sensor}" for time_s, sensor in alarms]
        with atomic_write(own / ALARMS) as aside:
            aside.write_text("\n".join(lines) + "\n", encoding="utf-8")
        with atomic_write(own / ENTRY) as aside:
            aside.write_text(
                f'name = "{name}"\ntitle = "{yardstick.title}"\ndefinition = "{definition.digest}"\n', encoding="utf-8"
            )
        written.append(own)
    return written


@dataclass(frozen=True)
class RawReading(SimpleDetector):
    """A limit on the readings themselves: each gyro and angle over its deviation on healthy flights.

    Examples
    --------
    >>> import gtmbench as gb
    >>> channels = RawReading().channels
    >>> healthy = gb.Record(np.tile([[-1.0], [1.0]], (50, 5)), channels=channels, sample_period_s=0.01)
    >>> monitor = RawReading().calibrate([healthy])
    >>> monitor.watch(healthy).scores["p"].values.max().round(6)
    np.float64(1.0)
    """

    name: str = "raw-reading"
    channels: tuple[str, ...] = (*GYROS, "phi", "theta")
    memory_s: float = 0.0

    def learn(self, records: Sequence[Record]) -> dict[str, list[float]]:
        """Return mean and deviation of every channel."""
        values = np.concatenate([record.matrix(self.channels) for record in records])
        return {"mean": np.nanmean(values, axis=0).tolist(), "deviation": np.nanstd(values, axis=0).tolist()}

    def scores(self, record: Record, learned: Mapping[str, Any]) -> dict[str, FloatArray]:
        """Return every channel's distance from its mean, over its deviation."""
        means, deviations = learned["mean"], learned["deviation"]
        return {
            name: np.abs(record[name] - means[column]) / deviations[column] for column, name in enumerate(self.channels)
        }
