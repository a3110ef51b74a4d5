"""What the contract suite looks at: a detector, its monitor, and a record with a fault; and how alarms are compared."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import cast

import numpy as np

from gtmbench.bench.sensors import measure
from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.protocol import Detector, Monitor, Watch, is_recipe
from gtmbench.detectors.registry import as_detector
from gtmbench.errors import InputError
from gtmbench.faults.fault import Fault, inject
from gtmbench.faults.kinds.additive import Drift
from gtmbench.intake.resampling import decimate
from gtmbench.method.problem import as_records
from gtmbench.testing.shared_flights import fly_once
from gtmbench.values.channels import GYROS
from gtmbench.values.record import Record

_SLACK = 1e-3  # of a sample: times of a part are rounded otherwise than those of the whole


@dataclass(frozen=True, kw_only=True, eq=False)
class ContractCase:
    """One detector under the contract."""

    detector: Detector | None  # None where a Monitor is checked, which is calibrated already
    monitor: Monitor
    healthy: tuple[Record, ...]  # that it was calibrated on
    last: Record  # healthy, and not of those
    faults: tuple[Fault, ...]

    @cached_property
    def record(self) -> Record:
        """The last with the faults."""
        return inject(self.last, self.faults)

    @cached_property
    def watch(self) -> Watch:
        """What the monitor says of the whole record."""
        return self.monitor.watch(self.record)

    @cached_property
    def cuts(self) -> tuple[int, ...]:
        """How many samples there are up to just before an alarm, with it, and some time later."""
        rows = [self.row(alarm.time_s) for alarm in self.watch.alarms[:1]]
        last = [self.row(alarm.time_s) for alarm in self.watch.alarms[-1:]]
        some = round(2.0 / self.record.sample_period_s)
        counts = [rows[0], rows[0] + 1, rows[0] + some, last[0] + some] if rows else [len(self.record) // 2]
        return tuple(sorted({min(max(count, 1), len(self.record)) for count in counts}))

    def row(self, time_s: float) -> int:
        """Return the sample at which something is known: the first at or after a time."""
        return int(np.ceil((time_s - self.record.start_s) / self.record.sample_period_s - _SLACK))

    def told(self, alarms: Iterable[Alarm], until_s: float = np.inf) -> list[str]:
        """Return what was said up to a time, in words that can be compared: times are rounded."""
        until_s += _SLACK * self.record.sample_period_s
        return [_words(alarm, until_s) for alarm in alarms if alarm.time_s <= until_s]


def contract_case(
    detector: object, records: Sequence[Record] | None = None, *, fault: Fault | Sequence[Fault] | None = None
) -> ContractCase:
    """Return a detector calibrated, and a record with a fault, for the properties of the contract."""
    given = as_detector(detector)
    *healthy, last = standard_records() if records is None else as_records(records)
    if not healthy:
        raise InputError("one record is given; give two or more, for it is calibrated on all but the last")
    recipe = given if is_recipe(given) else None
    monitor = recipe.calibrate(healthy) if recipe is not None else cast(Monitor, given)
    channel = next(name for name in (*monitor.channels, *last.channels) if name in last)
    channel = next((name for name in GYROS if name in (monitor.channels or ("p",))), channel)
    return ContractCase(
        detector=recipe,
        monitor=monitor,
        healthy=tuple(healthy),
        last=last,
        faults=tuple(_drifts(last, channel) if fault is None else [fault] if isinstance(fault, Fault) else fault),
    )


@cache
def standard_records() -> tuple[Record, ...]:
    """Return one flight of two minutes, sensed four times: some detectors know no other excitation than their own."""
    flight = fly_once(duration_s=120.0)
    return tuple(decimate(measure(flight, noise="t2", seed=seed, commands=True), 2) for seed in range(1, 5))


def _drifts(record: Record, channel: str) -> list[Fault]:
    length_s = record.end_s - record.start_s
    onsets_s = [record.start_s + round(share * length_s, 2) for share in (0.4, 0.7)]
    slope = 200.0 * float(np.nanstd(record[channel])) / length_s
    return [Drift(channel=channel, onset_s=onset_s, slope=slope, duration_s=0.1 * length_s) for onset_s in onsets_s]


def same(said: Sequence[str], wanted: Sequence[str], what: str, other: str) -> None:
    """Fail where two lists of what was said differ."""
    if list(said) != list(wanted):
        odd = next((i for i, pair in enumerate(zip(said, wanted, strict=False)) if pair[0] != pair[1]), None)
        at = min(len(said), len(wanted)) if odd is None else odd
        raise AssertionError(f"{what} {_listed(said[at:])}, {other} {_listed(wanted[at:])}")


def refused(what: str, act: Callable[[], object]) -> str:
    """Return the one line in which something is refused; fail where it isn't."""
    try:
        act()
    except InputError as error:
        said = str(error)
    except Exception as error:
        raise AssertionError(f"{what}: refused by {type(error).__name__} ({error}), not by an InputError") from error
    else:
        raise AssertionError(f"{what} is taken, where an InputError is due")
    if "\n" in said or not said:
        raise AssertionError(f"{what} is refused in {said.count(chr(10)) + 1} lines; say it in one")
    return said


def rows_of(record: Record, begin: int, end: int) -> Record:
    """Return samples begin..end-1 of a record; there may be none."""
    start_s = record.start_s + round(begin * record.sample_period_s, 9)
    return Record(
        record.values[begin:end], channels=record.channels, sample_period_s=record.sample_period_s, start_s=start_s
    )


def _words(alarm: Alarm, until_s: float) -> str:
    judged = [
        f"{judgement.time_s:.3f} s {judgement.sensor or ' or '.join(judgement.candidates) or 'nothing'}"
        for judgement in alarm.judgements
        if judgement.time_s <= until_s
    ]
    onset = "" if abs(alarm.onset_s - alarm.time_s) < 1e-6 else f" since {alarm.onset_s:.3f} s"
    words = f"{alarm.number}: {alarm.time_s:.3f} s{onset} {alarm.source} {alarm.test}".rstrip()
    return f"{words} ({', '.join(judged)})" if judged else words


def _listed(said: Sequence[str]) -> str:
    return "; ".join(said[:3]) + (f" and {len(said) - 3} more" if len(said) > 3 else "") if said else "none"
