"""The assertions on detectors: they detect in time, and are quiet on what is healthy."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

from gtmbench.checks import number, shown
from gtmbench.detectors.protocol import Monitor, Watch, is_ready, is_recipe
from gtmbench.errors import InputError
from gtmbench.faults.fault import Fault
from gtmbench.faults.kinds import inject
from gtmbench.kept import kept
from gtmbench.record import Record, check_record
from gtmbench.report.words.judgement import fault_text
from gtmbench.study.calibration import prepared
from gtmbench.study.score import NO_ALARM, altered_share, false_alarms, first_after, score
from gtmbench.testing.flights import calibration_records, standard_record

_TIE = 1e-9  # seconds
_calibrated: list[tuple[Any, Monitor]] = []  # detectors that were given uncalibrated, this session


def assert_detects(
    detector: Any, fault: Fault, *, within_s: float, record: Record | None = None, named: bool = False
) -> None:
    """Fail where a detector doesn't detect a fault in time, has a false alarm before it, or names another sensor.

    Parameters
    ----------
    detector : Monitor, Detector, callable, str or path
        A monitor, or what names one (``monitor.json``, ``FILE.py:OBJECT``); a function from a record to the times in
        seconds at which its alarms could be raised. A detector that is yet to calibrate is so once a session, on six
        healthy flights of 200 s with the T2's noise.
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
    >>> import numpy as np
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
    check_record(healthy)
    broken, due_s = inject(healthy, fault), fault.onset_s + within_s
    if due_s > broken.end_s + _TIE:
        raise InputError(
            f"an alarm is due at {due_s:g} s and the record ends at {broken.end_s:g} s; give a longer record, or an "
            "earlier onset"
        )
    if altered_share(fault, healthy, broken) == 0.0:
        raise InputError(f"the {fault_text(fault)} changes no sample of this record, so there is nothing to detect")
    monitor = _monitor(detector)
    if named and not monitor.suspects:
        raise InputError(f"'{monitor.name}' names no sensor; leave named=True out, or give a bank's monitor")
    watch = monitor.watch(broken)
    failed = [*_untimely(watch, fault, within_s), *_misnamed(watch, fault, healthy, named)]
    if failed:
        said = f"{fault_text(fault)} from {fault.onset_s:.2f} s: {'; '.join(failed)}"
        _fail(watch, said, fault=fault, healthy=healthy, due_s=due_s)


def assert_quiet(detector: Any, record: Record | None = None) -> None:
    """Fail where a detector alarms on a healthy record, or never could have.

    Parameters
    ----------
    detector : Monitor, Detector, callable, str or path
        As for `assert_detects`.
    record : Record, optional
        A healthy one; what the T2's sensors read on the standard flight (200 s) unless told.

    Raises
    ------
    AssertionError
        Naming the first alarm and the recording.

    Examples
    --------
    >>> assert_quiet(lambda record: record.time_s[abs(record["p"]) > 500.0])
    """
    __tracebackhide__ = True
    healthy = standard_record() if record is None else record
    check_record(healthy)
    watch = _monitor(detector).watch(healthy)
    alarms = false_alarms(watch)
    if alarms:
        what = f" ({alarms[0].verdict})" if alarms[0].judgements else ""
        more = f", and {len(alarms) - 1} more" if len(alarms) > 1 else ""
        _fail(watch, f"healthy record: alarm at {alarms[0].time_s:.2f} s{what}{more} (allowed: none)")
    stuck = [name for name, of in watch.scores.items() if of.is_stuck_above]
    if stuck:
        _fail(watch, f"healthy record: can't tell, for the score of {stuck[0]} stood above its threshold all the time")
    if watch.armed_hours == 0.0:
        _fail(watch, "healthy record: no alarm was possible, for no score exists; give a longer, complete record")


def _monitor(detector: Any) -> Monitor:
    """Return what was given as a monitor, calibrated once a session where it wasn't."""
    found = prepared(detector)
    if is_ready(found):
        return found
    for before, monitor in _calibrated:
        if before is detector or (isinstance(detector, str | Path) and before == detector):
            return monitor
    assert is_recipe(found)
    monitor = found.calibrate(list(calibration_records()))
    _calibrated.append((detector, monitor))
    return monitor


def _untimely(watch: Watch, fault: Fault, within_s: float) -> Iterator[str]:
    early = false_alarms(watch, fault.onset_s)
    if early:
        at_s = early[0].time_s
        yield f"false alarm at {at_s:.2f} s, {fault.onset_s - at_s:.2f} s before the onset (allowed: none)"
    told, allowed = first_after(watch.alarms, fault.onset_s), f"(allowed: within {within_s:g} s)"
    if told is None:
        yield f"no alarm until the record's end at {watch.record.end_s:.2f} s {allowed}"
    elif told.time_s > fault.onset_s + within_s + _TIE:
        yield f"alarm at {told.time_s:.2f} s, {told.time_s - fault.onset_s:.2f} s after the onset {allowed}"


def _misnamed(watch: Watch, fault: Fault, healthy: Record, named: bool) -> Iterator[str]:
    verdict = score(watch, fault=fault, healthy=healthy, broken=watch.record)
    if not verdict.detected:
        if verdict.reason != NO_ALARM:  # that has been told
            yield verdict.reason
    elif verdict.sensor != fault.channel and (named or verdict.sensor is not None):
        yield f"verdict: {verdict.verdict} (allowed: {fault.channel} failed)"


def _fail(
    watch: Watch, said: str, *, fault: Fault | None = None, healthy: Record | None = None, due_s: float | None = None
) -> NoReturn:
    __tracebackhide__ = True

    def write(path: Path) -> None:
        from gtmbench.report.recording.failure import FailedWatch, write_watch_recording

        write_watch_recording(FailedWatch(watch=watch, fault=fault, healthy=healthy, due_s=due_s, said=said), path)

    raise AssertionError(f"{said}; {kept().record(write)}")
