"""The assertions on monitors: they detect in time, and are quiet on what is healthy."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import ArrayLike

from gtmbench.bench.fault import Fault
from gtmbench.bench.faults import inject
from gtmbench.checks import number, shown
from gtmbench.detectors.bank.detector import BankMonitor
from gtmbench.detectors.bank.files import load_monitor
from gtmbench.detectors.protocol import Watch, watch
from gtmbench.errors import InputError
from gtmbench.kept import kept
from gtmbench.record import Record, is_record
from gtmbench.report.text import fault_text
from gtmbench.study.monitor_score import score_watch
from gtmbench.study.score import altered_share
from gtmbench.study.shared_flights import standard_record

_TIE = 1e-9  # seconds
Detector = BankMonitor | str | Path | Callable[[Record], ArrayLike]


def assert_detects(
    monitor: Detector, fault: Fault, *, within_s: float, record: Record | None = None, named: bool = False
) -> None:
    """Fail where a monitor doesn't detect a fault in time, alarms before it, or names another sensor.

    Parameters
    ----------
    monitor : BankMonitor, path of a monitor's file, or callable
        Or a function of your own, from a record to the times in seconds at which its alarms could be raised.
    fault : Fault
        Injected into the record, which has to last until an alarm is due.
    within_s : float
        How late the first alarm may be, in seconds after the onset, look-ahead and windows counted.
    record : Record, optional
        A healthy one; what the T2's sensors read on the standard flight (200 s) unless told.
    named : bool
        Whether the sensor has to be named as well. A wrong name fails in any case.

    Raises
    ------
    AssertionError
        Naming what was found, what was allowed and the recording.
    InputError
        Where an argument can't be meant, or the fault changes nothing.

    Examples
    --------
    >>> from gtmbench import Jam
    >>> def stuck(record):  # alarms where p stands still for 0.2 s
    ...     same = np.convolve(np.diff(record["p"]) == 0.0, np.ones(20))[: len(record) - 1] == 20.0
    ...     return record.time_s[1:][same][:1]
    >>> assert_detects(stuck, Jam(channel="p", onset_s=120), within_s=0.3)
    """
    __tracebackhide__ = True
    within_s = number("within_s", within_s, 0.0)
    if not isinstance(fault, Fault):
        raise InputError(f"{shown(fault)} is no fault; give one such as Jam(channel='p', onset_s=120)")
    healthy = standard_record() if record is None else record
    is_record(healthy)
    broken, due_s = inject(healthy, fault), fault.onset_s + within_s
    if due_s > broken.end_s + _TIE:
        raise InputError(
            f"an alarm is due at {due_s:g} s and the record ends at {broken.end_s:g} s; give a longer record, or an "
            "earlier onset"
        )
    if altered_share(fault, healthy, broken) == 0.0:
        raise InputError(f"the {fault_text(fault)} changes no sample of this record, so there is nothing to detect")
    seen = _watched(monitor, broken)
    failed = [*_untimely(seen, fault, within_s), *_misnamed(seen, fault, healthy, named)]
    if failed:
        said = f"{fault_text(fault)} from {fault.onset_s:.2f} s: {'; '.join(failed)}"
        _fail(seen, said, fault=fault, healthy=healthy, due_s=due_s)


def assert_quiet(monitor: Detector, record: Record | None = None) -> None:
    """Fail where a monitor alarms on a healthy record, or never could have.

    Parameters
    ----------
    monitor : BankMonitor, path of a monitor's file, or callable
        As for `assert_detects`.
    record : Record, optional
        A healthy one; what the T2's sensors read on the standard flight (200 s) unless told.

    Raises
    ------
    AssertionError
        Naming the first alarm and the recording.

    Examples
    --------
    >>> assert_quiet(lambda record: record.time_s[np.abs(record["p"]) > 500.0])
    """
    __tracebackhide__ = True
    healthy = standard_record() if record is None else record
    is_record(healthy)
    seen = _watched(monitor, healthy)
    if seen.alarms_s:
        what = f" ({seen.watch.findings[0].verdict})" if seen.watch else ""
        more = f", and {len(seen.alarms_s) - 1} more" if len(seen.alarms_s) > 1 else ""
        _fail(seen, f"healthy record: alarm at {seen.alarms_s[0]:.2f} s{what}{more} (allowed: none)")
    if seen.watch and seen.watch.armed_hours == 0.0:
        _fail(seen, "healthy record: no alarm was possible, for no level exists; give a longer, complete record")


@dataclass(frozen=True, kw_only=True, eq=False)
class _Seen:
    """What a monitor, or a function of the user's, made of a record."""

    record: Record
    alarms_s: tuple[float, ...]
    watch: Watch | None


def _watched(monitor: Detector, record: Record) -> _Seen:
    given = load_monitor(monitor) if isinstance(monitor, str | Path) else monitor
    if isinstance(given, BankMonitor):
        seen = watch(given, record)
        return _Seen(record=record, alarms_s=tuple(one.alarm_s for one in seen.findings), watch=seen)
    if not callable(given):
        raise InputError(f"a {type(given).__name__} is no monitor; give a BankMonitor, its file, or a function of a record")
    return _Seen(record=record, alarms_s=_times(given(record)), watch=None)


def _times(given: ArrayLike) -> tuple[float, ...]:
    try:
        times = np.atleast_1d(np.asarray(given, dtype=np.float64))
    except (TypeError, ValueError):
        times = np.array([np.nan])
    if times.ndim != 1 or not np.isfinite(times).all():
        raise InputError(f"the detector returned {shown(given)}; return the times of its alarms in seconds, or none")
    return tuple(sorted(times.tolist()))


def _untimely(seen: _Seen, fault: Fault, within_s: float) -> Iterator[str]:
    early = [alarm_s for alarm_s in seen.alarms_s if alarm_s < fault.onset_s - _TIE]
    if early:
        yield f"false alarm at {early[0]:.2f} s, {fault.onset_s - early[0]:.2f} s before the onset (allowed: none)"
    after = seen.alarms_s[len(early) :]
    allowed = f"(allowed: within {within_s:g} s)"
    if not after:
        yield f"no alarm until the record's end at {seen.record.end_s:.2f} s {allowed}"
    elif after[0] > fault.onset_s + within_s + _TIE:
        yield f"alarm at {after[0]:.2f} s, {after[0] - fault.onset_s:.2f} s after the onset {allowed}"


def _misnamed(seen: _Seen, fault: Fault, healthy: Record, named: bool) -> Iterator[str]:
    if seen.watch is None:
        if named:
            raise InputError("a function's alarms name no sensor; leave named=True out, or give a BankMonitor")
        return
    verdict = score_watch(seen.watch, fault=fault, healthy=healthy, broken=seen.record)
    if not verdict.detected:
        yield verdict.reason
    elif verdict.sensor != fault.channel and (named or verdict.sensor is not None):
        yield f"verdict: {verdict.verdict} (allowed: {fault.channel} failed)"


def _fail(
    seen: _Seen, said: str, *, fault: Fault | None = None, healthy: Record | None = None, due_s: float | None = None
) -> NoReturn:
    __tracebackhide__ = True

    def write(path: Path) -> None:
        from gtmbench.report.failure_recording import FailedWatch, write_watch_recording

        failed = FailedWatch(
            record=seen.record,
            alarms_s=seen.alarms_s,
            seen=seen.watch,
            fault=fault,
            healthy=healthy,
            due_s=due_s,
            said=said,
        )
        write_watch_recording(path, failed)

    raise AssertionError(f"{said}; {kept().record(write)}")
