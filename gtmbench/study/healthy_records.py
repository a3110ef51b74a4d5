"""Healthy records to calibrate a monitor on: flights of the bench, or logs, with imperfect sensors where wanted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from gtmbench.bench.aircraft import SAMPLE_PERIOD_S
from gtmbench.bench.attitude_filter import estimated_attitude
from gtmbench.bench.excitation import parts_of
from gtmbench.bench.flight import fly
from gtmbench.bench.known_aircraft import load_aircraft
from gtmbench.bench.loop import GAINS_WANTED, fly_in_loop
from gtmbench.bench.other_sensors import OtherSensors
from gtmbench.bench.sensor_chain import IDEAL
from gtmbench.bench.sensors import NOISES, Imperfections, drawn, imperfect, measure
from gtmbench.bench.stepping import LONGEST_S
from gtmbench.checks import meant, naming, number, whole
from gtmbench.detectors.monitor.regime import Regime
from gtmbench.detectors.protocol import Detector
from gtmbench.errors import EnvelopeError, InputError
from gtmbench.files.seals import file_digest
from gtmbench.intake.flight_log import FlightLog
from gtmbench.jobs.processes import spread
from gtmbench.jobs.progress import Progress, silent
from gtmbench.log.learning.undisturbed import Stretches, undisturbed
from gtmbench.log.opening.records import between_pauses, open_for, outside
from gtmbench.study.flights import check_flown, with_late_attitude
from gtmbench.values.attitude_estimators import OWN, estimator_of
from gtmbench.values.channels import COMMANDS, GYROS, SENSORS
from gtmbench.values.clock import same_period
from gtmbench.values.record import Record
from gtmbench.version import __version__

_MOST_FLIGHTS = 2000  # more is a mistake
_KILLED = "a process that flew was killed (no memory?); close others, or fly fewer"


@dataclass(frozen=True, kw_only=True)
class CalibrationFlights:
    """Flights to calibrate on, one a seed: of excitation, turbulence, noise and imperfections.

    An aircraft that leaves its envelope open loop is flown by its own autopilot, if it has one. For a detector that
    knows the commands every other flight is flown in the loop, where commands answer the motion, if there is an
    autopilot and no estimator.

    >>> from gtmbench.detectors.registry import find_detector
    >>> flights = CalibrationFlights(flights=2, duration_s=1.0)
    >>> [record.channels for record in flights.records(find_detector("paper"))]
    [('r', 'beta', 'p', 'q'), ('r', 'beta', 'p', 'q')]
    """

    flights: int = 60
    duration_s: float = 500.0  # of each
    aircraft: str = "gtm"  # aircraft, excitation: as `fly` takes them
    excitation: str = "multisine+turbulence"
    noise: str = "t2"
    seed: int = 1  # of the first flight; the others follow
    imperfections: Imperfections = field(default_factory=Imperfections)  # of the healthy gyros, to be tolerated
    # attitude: whose phi, theta and psi are: "own", or an estimator of
    # `gtmbench.values.attitude_estimators.ESTIMATORS`, driven by the gyros
    attitude: str = OWN
    attitude_late_s: float = 0.0  # how much later than the other sensors' the attitude's samples are
    sensors: str = IDEAL  # "ideal", or "chain": the aircraft's own chain lies between motion and readings
    others: OtherSensors = field(default_factory=OtherSensors)  # the magnetometer and the GPS that read, too

    def __post_init__(self) -> None:
        whole("flights", self.flights, 1, _MOST_FLIGHTS)
        number("duration_s", self.duration_s, SAMPLE_PERIOD_S, LONGEST_S)
        whole("seed", self.seed, 0, 2**31 - 1 - self.flights)
        load_aircraft(self.aircraft).chain_of(self.sensors)
        parts_of(self.excitation)
        estimator_of(self.attitude)
        if self.noise not in NOISES:
            raise InputError(f"no noise '{self.noise}'; there is {', '.join(NOISES)}{meant(self.noise, NOISES)}")

    def records(self, detector: Detector, *, processes: int = 1, progress: Progress = silent) -> list[Record]:
        """Fly, and return what the sensors that a detector uses read, in the order of the seeds.

        `processes`: more than one: flown side by side. The caller's main module is then imported by each of them, so a
        script needs its ``if __name__ == "__main__":``. `progress`: told the step, how many are flown, and of how many.
        """
        check_flown(detector.name, detector.channels, self.others)
        return self._all_flown(
            detector.channels or (*SENSORS, *self.others.channels), self.loops(detector), processes, progress
        )

    def sensed(self, channels: Sequence[str], *, processes: int = 1, progress: Progress = silent) -> list[Record]:
        """Fly, and return what some sensors read (and commands, where they are named), as `records` does."""
        return self._all_flown(channels, False, processes, progress)

    def _all_flown(self, channels: Sequence[str], loops: bool, processes: int, progress: Progress) -> list[Record]:
        tasks = [(self, tuple(channels), self.seed + i, loops and i % 2 == 1) for i in range(self.flights)]
        return spread(_flown, tasks, processes=processes, step="flying", progress=progress, killed=_KILLED)

    def loops(self, detector: Detector) -> bool:
        """Return whether every other flight is flown in the loop for a detector.

        >>> from gtmbench.detectors.registry import find_detector
        >>> [CalibrationFlights().loops(find_detector(name)) for name in ("surfaces", "C")]
        [True, False]
        """
        knows = set(COMMANDS) <= set(detector.channels) and self.attitude == OWN and not self.attitude_late_s
        return knows and load_aircraft(self.aircraft).autopilot is not None

    def provenance(self, detector: Detector | None = None) -> dict[str, object]:
        """Return where the records come from, as plain values without a date: the same flights, the same words."""
        return {
            "source": "flights",
            "aircraft": self.aircraft,
            "excitation": self.excitation,
            "duration_s": float(self.duration_s),
            "noise": self.noise,
            "seeds": [self.seed, self.seed + self.flights - 1],
            **({"in_the_loop": "every other flight"} if detector is not None and self.loops(detector) else {}),
            **({"attitude": self.attitude} if self.attitude != OWN else {}),
            **({"sensors": self.sensors} if self.sensors != IDEAL else {}),
            **({"attitude_late_s": self.attitude_late_s} if self.attitude_late_s else {}),
            **self.others.facts,
            **_common(self.imperfections),
        }


def logged_records(
    paths: Sequence[Path],
    detector: Detector,
    *,
    mapping: Sequence[str] = (),
    rate_hz: float | None = None,
    imperfections: Imperfections | None = None,
    seed: int = 1,
    progress: Progress = silent,
) -> tuple[list[Record], dict[str, Any]]:
    """Read healthy logs; return the channels that a detector uses, and the logs' provenance.

    `paths`: as `open_log` takes them; each segment between gaps, and between pauses of a channel, is a record. What is
    no flight with a settled attitude is left out (`undisturbed`), and the provenance says so; the regime of what is
    left stands there, too. `mapping`: as `open_log` takes it, for all of them. `rate_hz`: the rate to resample to, in
    Hz; by default the first log's own. `imperfections`: added to the gyros that the detector uses, to be tolerated.
    `seed`: of the first record's imperfections; the others follow.
    """
    added = imperfections or Imperfections()
    records: list[Record] = []
    opened: list[FlightLog] = []
    logs: list[dict[str, str]] = []
    for i, path in enumerate(paths):
        progress("reading", i, len(paths))
        log = open_for(path, detector, mapping=mapping, rate_hz=rate_hz)
        if records and not same_period(log.sample_period_s, records[0].sample_period_s):
            if log.sample_period_s > records[0].sample_period_s:
                raise InputError(
                    f"{path}: it is sampled every {log.sample_period_s:g} s, {paths[0].name} every "
                    f"{records[0].sample_period_s:g} s; a monitor has one sample period, so give the slowest log first"
                )
            log = open_for(path, detector, mapping=mapping, rate_hz=1.0 / records[0].sample_period_s)
        digest = file_digest(path)
        twin = next((before["name"] for before in logs if before["sha256"] == digest), None)
        if twin is not None:
            raise InputError(f"{path} holds the same as {twin}; give every flight once")
        logs.append({"name": path.name, "sha256": digest})
        with naming(path):
            records += between_pauses(log.segments, detector.channels)
        opened += [log] * (len(records) - len(opened))
    healthy = undisturbed(detector, Stretches(records=tuple(records), logs=tuple(opened)))
    if healthy.left_out:  # least squares take no gaps
        records = between_pauses(healthy.records, detector.channels)
    each_once = {id(log): log for log in opened}.values()
    flown = [piece for log in each_once for piece in outside(log.segments, healthy.left_out_of(log))]
    origin = {"source": "logs", "logs": logs, "regime": Regime.of(flown).table, **_common(added)}
    return (
        [_with(record, added, seed + number) for number, record in enumerate(records)],
        origin | ({"left_out": healthy.reasons} if healthy.left_out else {}),
    )


def _common(imperfections: Imperfections) -> dict[str, str]:
    tolerated = str(imperfections) if imperfections != Imperfections() else "none"
    return {"tolerated_imperfections": tolerated, "gtmbench": __version__, "numpy": np.__version__}


def _flown(task: tuple[CalibrationFlights, tuple[str, ...], int, bool]) -> Record:
    flights, channels, seed, in_loop = task
    if in_loop:
        how = (flights.aircraft, flights.excitation, flights.duration_s, seed)
        flown = fly_in_loop(*how, noise=flights.noise, sensors=flights.sensors)
        read = _with(flown.readings(commands=True), flights.imperfections, seed)
        return flights.others.beside(read, flown.truth, seed).select(channels)
    flight = _truth(flights, seed)
    chain = load_aircraft(flights.aircraft).chain_of(flights.sensors)
    measured = measure(flight, noise=flights.noise, seed=seed, commands=True, sensors=chain)
    gyros = _with(measured, flights.imperfections, seed)  # an estimator reads them as they are
    estimated = estimated_attitude(gyros, flight, flights.attitude, seed)
    late = with_late_attitude(estimated, flights.attitude_late_s)
    return flights.others.beside(late, flight, seed).select(channels)


def _truth(flights: CalibrationFlights, seed: int) -> Record:
    """Fly open loop; where that leaves the envelope, with the aircraft's autopilot."""
    how = (flights.aircraft, flights.excitation, flights.duration_s, seed)
    try:
        return fly(*how)
    except EnvelopeError as error:
        if load_aircraft(flights.aircraft).autopilot is None:
            raise EnvelopeError(f"{error}; or {GAINS_WANTED}: then it is flown in the loop") from error
        return fly_in_loop(*how).truth


def _with(record: Record, imperfections: Imperfections, seed: int) -> Record:
    gyros = [name for name in GYROS if name in record]
    return imperfect(record, drawn(imperfections, seed=seed), channels=gyros, seed=seed) if gyros else record
