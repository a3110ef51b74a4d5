"""The detector of surfaces: a recipe that knows the commands, and its monitor.

It stands beside a bank of sensors and answers another question. Kinematics hold and the aircraft doesn't answer as it
did: a surface, an engine, damage or wind. Kinematics don't hold: a sensor, which is the banks' business and is never
named here. So it has a bank of kinematics of its own, which only ever keeps it from naming a surface.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from gtmbench.checks import number, shown
from gtmbench.detectors.bank.bank import Bank, load_bank
from gtmbench.detectors.bank.calibration import divided
from gtmbench.detectors.bank_detector import BankMonitor, restore_bank
from gtmbench.detectors.bank_detector import calibrate as calibrate_bank
from gtmbench.detectors.gate import gated
from gtmbench.detectors.protocol import Watch
from gtmbench.detectors.statistics.thresholds import RATE, HealthyMaxima, ScoreMaxima, block_maxima, rate_bound
from gtmbench.detectors.surfaces.answer import BLOCK_S, Answer, DeviationBlocks, answer_of
from gtmbench.detectors.surfaces.deviation import ANSWER, KINDS, LABELS, OFFSET, Normal, changes, normal_of
from gtmbench.detectors.surfaces.equations import FULL, THROTTLE, Flow
from gtmbench.detectors.surfaces.identification import SETTLES_S, identified
from gtmbench.detectors.surfaces.stream import SurfaceStream
from gtmbench.detectors.tables import PERIODS_S, array_of, keys, table_of
from gtmbench.errors import InputError
from gtmbench.jobs.progress import Progress, silent
from gtmbench.method.problem import taught_records
from gtmbench.values.channels import COMMANDS, GYROS
from gtmbench.values.record import FloatArray, Record

_KINEMATIC_RATE = 1.0  # false alarms an hour that may keep a surface from being named
_MINUTE_S = 60.0  # before a window, that it is compared with
_SLOWEST_S = 0.125  # sample period
_SHORTEST_S = 60.0  # of a healthy record without a hole: a window's minute before
_MOSTLY = 0.9  # of the moments
_PASSES_NOTHING = 1e6  # nats: of a test that no healthy record was long enough for


@dataclass(frozen=True, kw_only=True)
class SurfaceDetector:
    """A recipe for the aircraft's answer to its commands, beside kinematics.

    Parameters
    ----------
    name : str
    flow : Flow
        The channels by which the flow is known: vanes and airspeed, or accelerometers alone.

    Examples
    --------
    >>> import gtmbench as gb
    >>> flown = [gb.fly("gtm", "multisine+turbulence", 150.0, seed) for seed in (1, 2, 3)]
    >>> healthy = [gb.measure(flight, noise="t2", seed=1, commands=True) for flight in flown]
    >>> monitor = gb.SurfaceDetector().calibrate(healthy)
    >>> weak = gb.ScaleFactor(channel="rudder", onset_s=60.0, factor=0.3)
    >>> broken = gb.fly("gtm", "multisine+turbulence", 100.0, 4, faults=weak)
    >>> watch = monitor.watch(gb.measure(broken, noise="t2", seed=4, commands=True))
    >>> [alarm.verdict for alarm in watch.faults]
    ['rudder failed']
    """

    name: str = "surfaces"
    flow: Flow = FULL

    @property
    def title(self) -> str:
        """What it is, in a line."""
        by = "vanes" if self.flow.vanes else "accelerometers"
        air = "" if self.flow.airspeed else ", at one airspeed"
        blind = "" if self.flow.forward else ", blind to the throttle"
        return f"the aircraft's answer to its commands, the flow by {by}{air}, beside kinematics{blind}"

    @property
    def channels(self) -> tuple[str, ...]:
        """Gyros, the channels of the flow, the commands, and the channels of kinematics."""
        return tuple(dict.fromkeys((*GYROS, *self.flow.channels, *COMMANDS, *_kinematics().channels)))

    def calibrate(
        self, records: Sequence[Record], false_alarms_per_hour: float | None = None, *, progress: Progress = silent
    ) -> SurfaceMonitor:
        """Identify the answer on every third record and set thresholds on the others; 40 % and the rest of one.

        Parameters
        ----------
        records : sequence of Record
            Healthy, of one sample period, in which the surfaces move.
        false_alarms_per_hour : float, optional
            False alarm rate of the whole monitor; by default 0.002.
        progress : callable
            Called with the step, how many are done, and of how many.

        Raises
        ------
        InputError
            If channels are missing, no surface moves, or the records are too short or sampled too slowly.
        """
        rate = (
            RATE if false_alarms_per_hour is None else number("false_alarms_per_hour", false_alarms_per_hour, 1e-9, 1e3)
        )
        healthy = [record.select(self.channels) for record in taught_records(records)]
        period_s = healthy[0].sample_period_s
        _check(self.name, healthy)
        learn, judged = ([part.matrix(_read(self.flow)) for part in parts] for parts in divided(healthy))
        progress("identify", 0, 3)
        answer = identified(self.flow, learn, period_s)
        progress("thresholds", 1, 3)
        blocks = [_settled(answer, values, period_s) for values in judged]
        normal = normal_of(blocks)
        seen = _seen(answer, normal, blocks)
        found = seen.thresholds(rate)
        progress("kinematics", 2, 3)
        kinematics = calibrate_bank(healthy, bank=_kinematics(), false_alarms_per_hour=max(rate, _KINEMATIC_RATE))
        hours = sum(map(len, judged)) * period_s / 3600.0
        progress("done", 3, 3)
        return SurfaceMonitor(
            name=self.name,
            answer=answer,
            normal=normal,
            thresholds={
                surface: {label: min(value, _PASSES_NOTHING) for label, value in of.items()}
                for surface, of in found.items()
            },
            kinematics=kinematics,
            sample_period_s=period_s,
            provenance={
                "records": len(healthy),
                "threshold_hours": hours,
                "threshold_spread": seen.luck(rate).table(),
                "false_alarms_per_hour": rate,
                "false_alarms_per_hour_at_most": rate_bound(0, hours),
            },
        )

    def restore(
        self, figures: Mapping[str, Any], provenance: Mapping[str, Any] = MappingProxyType({})
    ) -> SurfaceMonitor:
        """Return the monitor of some figures; they have to be of this flow."""
        monitor = restore_surfaces(figures, provenance)
        if monitor.answer.frame.flow != self.flow:
            raise InputError(f"the figures are of '{monitor.name}', which reads the flow otherwise; calibrate anew")
        return monitor


SURFACE_DETECTORS = {
    detector.name: detector
    for detector in (
        SurfaceDetector(),
        SurfaceDetector(name="surfaces-no-nx", flow=Flow()),
        SurfaceDetector(name="surfaces-no-vanes", flow=Flow(vanes=False)),
        SurfaceDetector(name="surfaces-no-air", flow=Flow(vanes=False, airspeed=False)),
    )
}


def _kinematics() -> Bank:
    return load_bank("C")


def _read(flow: Flow) -> tuple[str, ...]:
    return (*GYROS, *flow.channels, *COMMANDS)


def _check(name: str, healthy: Sequence[Record]) -> None:
    period_s = healthy[0].sample_period_s
    if period_s > _SLOWEST_S:
        raise InputError(
            f"'{name}' needs {1.0 / _SLOWEST_S:g} samples a second or more, and these records have {1.0 / period_s:.3g}"
        )
    longest_s = max(map(len, healthy)) * period_s
    if longest_s < _SHORTEST_S:
        raise InputError(
            f"'{name}' compares what it sees with the minute before, and the longest healthy record has "
            f"{longest_s:.3g} s; give records of some minutes"
        )


def _settled(answer: Answer, values: FloatArray, period_s: float) -> DeviationBlocks:
    """Return the blocks of a record, once the filters have settled."""
    blocks = answer.start(period_s).push(values)
    first = round(SETTLES_S / blocks.block_s)
    return blocks._replace(means=blocks.means[first:], there=blocks.there[first:])


def _seen(answer: Answer, normal: Normal, healthy: Sequence[DeviationBlocks]) -> HealthyMaxima:
    """Return the greatest values of all tests in minutes of healthy flight."""
    tests: dict[tuple[str, str], ScoreMaxima] = {}
    block_s = healthy[0].block_s
    minute = round(_MINUTE_S / block_s)
    for blocks in healthy:
        nats = normal.nats(changes(blocks, normal.white))
        for i, surface in enumerate(answer.frame.surfaces):
            for test, label in enumerate(LABELS):
                values = nats[:, test, i]
                if np.isfinite(values).any():
                    new = ScoreMaxima(reach=minute, least=lambda _: _LEAST_NATS, in_nats=True)
                    seen = tests.setdefault((surface, label), new)
                    seen.maxima.append(block_maxima(values, minute))
                    seen.greatest.append(float(np.nanmax(values)))
    if not tests:
        raise InputError(f"the healthy records are too short; one of {_SHORTEST_S:g} s without a hole is needed")
    return HealthyMaxima(tests=tests, rows=minute, sample_period_s=block_s)


_LEAST_NATS = 8.0  # what white noise would pass 3 times in 10,000 independent windows


@dataclass(frozen=True, kw_only=True)
class SurfaceSizes:
    """The least faults of a surface that would be detected.

    Attributes
    ----------
    offset : float
        A constant deflection beside the command: in degrees, of the throttle in percent.
    loss : float
        The share of effectiveness that is lost: 0.3 leaves 70 % of the command.
    lost_seen : float
        The share of the moments in which the loss of all of it would be detected.

    Examples
    --------
    >>> import gtmbench as gb
    >>> gb.SurfaceSizes(offset=0.4, loss=0.3)
    SurfaceSizes(offset=0.4, loss=0.3, lost_seen=1.0)
    """

    offset: float
    loss: float
    lost_seen: float = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceMonitor:
    """An answer that was identified, and what is usual of it.

    Attributes
    ----------
    name : str
    answer : Answer
    normal : Normal
    thresholds : mapping of surface to mapping of test to float
        In nats.
    kinematics : BankMonitor
        Of the sensors: where it alarms, no surface is named.
    sample_period_s : float

    Examples
    --------
    >>> import gtmbench as gb
    >>> flown = [gb.fly("gtm", "multisine+turbulence", 150.0, seed) for seed in (1, 2, 3)]
    >>> healthy = [gb.measure(flight, noise="t2", seed=1, commands=True) for flight in flown]
    >>> monitor = gb.SurfaceDetector().calibrate(healthy)
    >>> monitor.suspects, isinstance(monitor, gb.SurfaceMonitor)
    (('elevator', 'aileron', 'rudder'), True)
    >>> monitor.unwatched  # flown open loop
    {'throttle': 'its command never moved in the healthy flights'}
    >>> sizes = monitor.sizes(healthy[2])  # from which size on a fault alarms, as this record is excited
    >>> all(0.0 < least.offset < 5.0 for least in sizes.values())
    True
    """

    name: str
    answer: Answer = field(repr=False)
    normal: Normal = field(repr=False)
    thresholds: Mapping[str, Mapping[str, float]] = field(repr=False)
    kinematics: BankMonitor = field(repr=False)
    sample_period_s: float
    provenance: Mapping[str, object] = field(default_factory=dict)

    look_ahead_s: ClassVar[float] = BLOCK_S
    memory_s: ClassVar[float] = float("inf")

    @property
    def channels(self) -> tuple[str, ...]:
        """The recipe's."""
        return SurfaceDetector(flow=self.answer.frame.flow).channels

    @property
    def suspects(self) -> tuple[str, ...]:
        """The surfaces that moved in the healthy flights."""
        return self.answer.frame.surfaces

    @property
    def unwatched(self) -> dict[str, str]:
        """Why commands are not judged, by command."""
        lacking = [name for name in FULL.channels if name not in self.answer.frame.flow.channels]
        why = {name: "its command never moved in the healthy flights" for name in COMMANDS if name not in self.suspects}
        return why | ({THROTTLE: f"{', '.join(lacking)} would have to be read"} if lacking else {})

    @property
    def _limits(self) -> FloatArray:
        """The thresholds, shape (tests, surfaces); infinite where there is none."""
        of = [self.thresholds[name] for name in self.suspects]
        return np.array([[each.get(label, np.inf) for each in of] for label in LABELS])

    def stream(self) -> SurfaceStream:
        """Return a fresh stream; its memory, and time a sample, don't grow."""
        return SurfaceStream(self, self.answer, self.normal, self._limits, self.kinematics, self.sample_period_s)

    @gated
    def watch(self, record: Record) -> Watch:
        """Return scores and alarms: a stream's, of the record as one chunk.

        Raises
        ------
        InputError
            If the record lacks a channel or has another sample period.
        """
        return self.stream().taken(record).watch(self, record, lambda name: (name,))

    def sizes(self, record: Record) -> dict[str, SurfaceSizes]:
        """Return from which size on a fault of each surface would be detected, as a record is excited.

        At 90 % of the moments that are watched, within 48 s. A command that hardly moves shows no loss of
        effectiveness, however large: then `loss` is above 1.

        Parameters
        ----------
        record : Record
            Healthy, with the monitor's channels.

        Raises
        ------
        InputError
            If the record lacks a channel, has another sample period, or is too short to be judged.

        Examples
        --------
        >>> import gtmbench as gb
        >>> flown = [gb.fly("gtm", "multisine+turbulence", 150.0, seed) for seed in (1, 2, 3)]
        >>> healthy = [gb.measure(flight, noise="t2", seed=1, commands=True) for flight in flown]
        >>> sizes = gb.SurfaceDetector().calibrate(healthy).sizes(healthy[2])
        >>> 0.1 < sizes["rudder"].offset < sizes["aileron"].offset, sizes["rudder"].loss < 1.0
        (True, True)
        """
        kept = record.select(self.channels)
        kept.check_period(self.sample_period_s, f"'{self.name}' was calibrated at")
        blocks = _settled(self.answer, kept.matrix(_read(self.answer.frame.flow)), self.sample_period_s)
        found = changes(blocks, self.normal.white)
        least = self.normal.smallest(found, self._limits)
        by_kind = {kind: [i for i, of in enumerate(KINDS) if of == kind] for kind in (OFFSET, ANSWER)}
        sizes = {}
        for i, (surface, step) in enumerate(zip(self.suspects, self.answer.frame.steps, strict=True)):
            offsets, losses = (_judged(least[:, tests, i]) for tests in by_kind.values())
            sizes[surface] = SurfaceSizes(
                offset=float(step * np.quantile(offsets, _MOSTLY, axis=0).min()),
                loss=float(np.quantile(losses, _MOSTLY, axis=0).min()),
                lost_seen=float(np.mean(losses <= 1.0, axis=0).max()),
            )
        return sizes

    def figures(self) -> dict[str, object]:
        """Return sample period, answer, thresholds and kinematics as plain JSON values."""
        return {
            "sample_period_s": self.sample_period_s,
            "name": self.name,
            "answer": self.answer.table(),
            "noise": self.normal.noise.tolist(),
            "white": self.normal.white.tolist(),
            "colour": self.normal.colour.tolist(),
            "thresholds": {series: dict(of) for series, of in self.thresholds.items()},
            "kinematics": self.kinematics.figures(),
        }


def _judged(least: FloatArray) -> FloatArray:
    """Return what some tests need at the moments at which all of them judge."""
    judged = np.isfinite(least).all(axis=1)
    if not judged.any():
        raise InputError(f"nothing of this record can be judged; give a healthy one of {2 * _SHORTEST_S:g} s or more")
    return least[judged]


def restore_surfaces(figures: Mapping[str, Any], provenance: Mapping[str, Any]) -> SurfaceMonitor:
    """Return the monitor of some figures; every key is checked.

    InputError naming the key, what stands there and what should.
    """
    names = ("sample_period_s", "name", "answer", "noise", "white", "colour", "thresholds", "kinematics")
    figures = keys("figures", figures, names)
    if not isinstance(figures["name"], str):
        raise InputError(f"figures.name is {shown(figures['name'])}; it must be a text")
    if "by_airspeed" in table_of("figures.answer", figures["answer"]):
        raise InputError(
            "it was calibrated by an earlier version, which identified less of the answer to commands; calibrate anew"
        )
    answer = answer_of("figures.answer", figures["answer"])
    surfaces = len(answer.frame.surfaces)
    thresholds = table_of("figures.thresholds", figures["thresholds"])
    return SurfaceMonitor(
        name=figures["name"],
        answer=answer,
        normal=Normal(
            noise=array_of("figures.noise", figures["noise"], (surfaces,)),
            white=array_of("figures.white", figures["white"], (surfaces,)),
            colour=array_of("figures.colour", figures["colour"], (len(LABELS), surfaces)),
        ),
        thresholds={name: _thresholds(name, thresholds.get(name)) for name in answer.frame.surfaces},
        kinematics=restore_bank(table_of("figures.kinematics", figures["kinematics"]), {}),
        sample_period_s=number("sample_period_s", figures["sample_period_s"], *PERIODS_S),
        provenance=dict(provenance),
    )


def _thresholds(surface: str, given: Any) -> dict[str, float]:
    where = f"figures.thresholds.{surface}"
    table = table_of(where, given)
    if not table or not set(table) <= set(LABELS):
        raise InputError(f"{where} holds {', '.join(table) or 'nothing'}; it may hold {', '.join(LABELS)}")
    return {label: number(f"{where}.{label}", value, 0.0, above=True) for label, value in table.items()}
