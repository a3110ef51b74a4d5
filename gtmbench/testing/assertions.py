"""The assertions: a detector detects in time, is quiet on what is healthy, and a residual stays below a bound."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, cast

import numpy as np

from gtmbench.checks import number, shown
from gtmbench.detectors.protocol import Monitor, Watch, is_ready, is_recipe
from gtmbench.detectors.registry import prepared
from gtmbench.errors import InputError
from gtmbench.faults.fault import Fault, inject
from gtmbench.files.artefacts import artefacts
from gtmbench.files.writing import LOGS, no_such
from gtmbench.intake.flight_log import FlightLog
from gtmbench.method.residual import Residual, residual
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.report.words.judgement import fault_text
from gtmbench.study.score import NO_ALARM, altered_share, false_alarms, first_after, score
from gtmbench.testing.on_logs import hold_found, hold_quiet, is_flight, watched_log
from gtmbench.testing.shared_flights import calibration_records, standard_record
from gtmbench.values.channels import unit_of
from gtmbench.values.record import Record, check_record

if TYPE_CHECKING:
    from gtmbench.log.watched_log import WatchedLog

_TIE = 1e-9  # seconds
Predictor = Transmissibility | Callable[[Record], Residual]
Bound = float | Mapping[str, float]
_calibrated: list[tuple[Any, Monitor]] = []  # detectors that were given uncalibrated, this session


def assert_detects(
    detector: object,
    fault: Fault | None = None,
    *,
    within_s: float,
    record: Record | FlightLog | str | Path | None = None,
    named: bool = False,
    sensor: str | None = None,
    from_s: float | None = None,
    healthy: Sequence[tuple[float, float] | str | Path] = (),
    mapping: Sequence[str] = (),
) -> None:
    """Fail if a detector doesn't detect a fault in time, has a false alarm before it, or names another sensor.

    Of a recorded flight with a failure, ``assert_detects("flight.csv", sensor="q", from_s=100, within_s=5)`` fails
    unless that sensor failed from about that time on, and no other sensor did.

    Parameters
    ----------
    detector : Monitor, Detector, callable, str or path; or a log
        A monitor or its name (``monitor.json``, ``FILE.py:OBJECT``), or a function from a record to the times in
        seconds at which its alarms could be raised. An uncalibrated detector is calibrated once a session, on six
        healthy flights of 200 s with the T2's noise. Or a recorded flight, a `FlightLog` or its path, which detector
        auto watches as ``gtmbench monitor`` does.
    fault : Fault, optional
        Injected into the record, which must last until an alarm is due; none where a recorded flight has its own.
    within_s : float
        The greatest detection delay allowed, in seconds, look-ahead and windows included. Of a recorded flight: how far
        the beginning that is found, with hindsight, may lie from `from_s`.
    record : Record, optional
        A healthy record; by default the T2's sensor readings on the standard flight (200 s). Or a recorded flight that
        the detector watches.
    named : bool
        Whether the sensor must also be named. A wrong name always fails.
    sensor, from_s : str and float, optional
        Of a recorded flight: which sensor failed, and from when on, on the log's clock in seconds.
    healthy, mapping : sequence, optional
        Of a recorded flight: as `watch_log` takes them.

    Raises
    ------
    AssertionError
        Naming the finding, the bound and the recording.
    InputError
        If an argument is invalid, or the fault changes nothing.

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
    watching = _on_log(detector, record, healthy=healthy, mapping=mapping)
    if watching is not None:
        if fault is not None or sensor is None or from_s is None:
            raise InputError("a recorded flight has its own fault; give sensor='q' and from_s=100, and no fault")
        hold_found(watching(), sensor=sensor, from_s=from_s, within_s=within_s)
        return
    within_s = number("within_s", within_s, 0.0)
    if not isinstance(fault, Fault):
        raise InputError(f"{shown(fault)} is no fault; give one such as Jam(channel='p', onset_s=120)")
    sound = _record(record)
    broken, due_s = inject(sound, fault), fault.onset_s + within_s
    if due_s > broken.end_s + _TIE:
        raise InputError(
            f"an alarm is due at {due_s:g} s and the record ends at {broken.end_s:g} s; give a longer record, or an "
            "earlier onset"
        )
    if altered_share([fault], sound, broken) == 0.0:
        raise InputError(f"the {fault_text(fault)} changes no sample of this record, so there is nothing to detect")
    monitor = _monitor(detector)
    if named and not monitor.suspects:
        raise InputError(f"'{monitor.name}' names no sensor; leave named=True out, or give a bank's monitor")
    watch = monitor.watch(broken)
    failed = [*_untimely(watch, fault, within_s), *_misnamed(watch, fault, sound, named)]
    if failed:
        said = f"{fault_text(fault)} from {fault.onset_s:.2f} s: {'; '.join(failed)}"
        _fail_watch(watch, said, fault=fault, healthy=sound, due_s=due_s)


def assert_quiet(
    detector: object,
    record: Record | FlightLog | str | Path | None = None,
    *,
    judge: str | None = None,
    limits: Sequence[str] = (),
    healthy: Sequence[tuple[float, float] | str | Path] = (),
    mapping: Sequence[str] = (),
    history: str | Path | None = None,
    aircraft_id: str = "",
) -> None:
    """Fail if a detector alarms on a healthy record, or never could have.

    ``assert_quiet("flight.csv")`` fails unless `gtmbench monitor` finds nothing in a recorded flight, and judges
    enough of it; with ``history="airframe.parquet"`` its constants have to be those of the airframe's flights before.

    Parameters
    ----------
    detector : Monitor, Detector, callable, str or path; or a log
        As for `assert_detects`.
    record : Record, optional
        A healthy record; by default the T2's sensor readings on the standard flight (200 s). Or a recorded flight that
        the detector watches.
    judge, limits, healthy, mapping, history, aircraft_id : optional
        Of a recorded flight: as `watch_log` takes them.

    Raises
    ------
    AssertionError
        Naming the first alarm and the recording.

    Examples
    --------
    >>> assert_quiet(lambda record: record.time_s[abs(record["p"]) > 500.0])
    """
    __tracebackhide__ = True
    how = {"judge": judge, "limits": limits, "healthy": healthy, "mapping": mapping, "history": history}
    watching = _on_log(detector, record, **how, aircraft_id=aircraft_id)
    if watching is not None:
        hold_quiet(watching())
        return
    sound = _record(record)
    watch = _monitor(detector).watch(sound)
    alarms = false_alarms(watch)
    if alarms:
        what = f" ({alarms[0].verdict})" if alarms[0].judgements else ""
        more = f", and {len(alarms) - 1} more" if len(alarms) > 1 else ""
        _fail_watch(watch, f"healthy record: alarm at {alarms[0].time_s:.2f} s{what}{more} (allowed: none)")
    stuck = [name for name, of in watch.scores.items() if of.is_stuck_above]
    if stuck:
        _fail_watch(
            watch, f"healthy record: can't tell, for the score of {stuck[0]} stood above its threshold all the time"
        )
    if watch.armed_hours == 0.0:
        _fail_watch(watch, "healthy record: no alarm was possible, for no score exists; give a longer, complete record")


def _on_log(detector: object, record: object, **how: Any) -> Callable[[], WatchedLog] | None:
    """Return how a recorded flight is watched; None where none was given, nor anything that is of one."""
    if is_flight(record):
        return partial(watched_log, record, detector, **how)
    if record is None and is_flight(detector):
        return partial(watched_log, detector, **how)
    if isinstance(record, str | Path):
        raise InputError(no_such(Path(record)) if not Path(record).exists() else f"{record} is no log")
    if isinstance(detector, str | Path) and Path(detector).suffix.lower() in LOGS and not Path(detector).exists():
        raise InputError(no_such(Path(detector)))
    given = [name for name, value in how.items() if value]
    if given:
        raise InputError(f"{given[0]} is about a recorded flight, and none is given; give a FlightLog, or its path")
    return None


def _record(given: object) -> Record:
    record: Any = standard_record() if given is None else given
    check_record(record)
    return cast("Record", record)


def _monitor(detector: object) -> Monitor:
    """Return what was given as a monitor, calibrated once a session where it wasn't."""
    given = prepared(detector)
    if is_ready(given):
        return given
    for before, monitor in _calibrated:
        if before is detector or (isinstance(detector, str | Path) and before == detector):
            return monitor
    assert is_recipe(given)
    monitor = given.calibrate(list(calibration_records()))
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


def assert_residual(record: Record, operator: Predictor, *, below: Bound, rms_below: Bound | None = None) -> None:
    """Fail if the residual of an operator reaches a bound anywhere on a record.

    Parameters
    ----------
    record : Record
        The record, or a part such as ``record.between(25, 200)``.
    operator : Transmissibility or callable
        Or a function from a record to a `Residual`, such as ``lambda record: gb.innovations(operator, record)``.
    below : float or mapping of output to float
        The bound of every ``|e(k)|``, in the output's unit; one spike fails it. Residuals that need a missing sample
        don't exist and are skipped; some must exist.
    rms_below : float or mapping of output to float, optional
        The bound of the root mean square over the record, in the output's unit.

    Raises
    ------
    AssertionError
        Naming output, figure, bound and recording.
    InputError
        If an argument is invalid.

    Examples
    --------
    >>> from gtmbench import identify
    >>> u = np.random.default_rng(1).standard_normal(500)
    >>> record = Record(np.column_stack([u, 2.0 * u]), channels=["u", "y"], sample_period_s=0.01)
    >>> operator = identify(record, inputs=["u"], outputs=["y"], causal_order=1, noncausal_order=1)
    >>> assert_residual(record, operator, below=0.01)
    """
    __tracebackhide__ = True
    check_record(record)
    residuals = _residuals(record, operator)
    bounds = _bounds("below", below, residuals.outputs)
    failed = [complaint for name in residuals.outputs for complaint in _too_large(residuals, name, bounds[name])]
    if rms_below is not None:
        rms_bounds = _bounds("rms_below", rms_below, residuals.outputs)
        failed += [
            complaint for name in residuals.outputs for complaint in _too_strong(residuals, name, rms_bounds[name])
        ]
    if not failed:
        return
    said = "; ".join(failed)

    def write(path: Path) -> None:
        from gtmbench.report.recording.watch import write_residual_recording

        inputs = operator.inputs if isinstance(operator, Transmissibility) else ()
        write_residual_recording(residuals, path, record=record, inputs=inputs, bounds=bounds, said=said)

    _fail(said, write)


def _residuals(record: Record, operator: Predictor) -> Residual:
    if isinstance(operator, Transmissibility):
        return residual(operator, record)
    if not callable(operator):
        raise InputError(f"a {type(operator).__name__} is no operator; give a Transmissibility, or a function")
    residuals = operator(record)
    if not isinstance(residuals, Residual):
        raise InputError(f"the function returned a {type(residuals).__name__}; it has to return a Residual")
    return residuals


def _bounds(name: str, given: Bound, outputs: tuple[str, ...]) -> dict[str, float]:
    table = given if isinstance(given, Mapping) else dict.fromkeys(outputs, given)
    if set(table) != set(outputs):
        raise InputError(
            f"{name} is for {', '.join(map(shown, table))}; give a number, or one for each of {', '.join(outputs)}"
        )
    return {output: number(f"{name} of {output}", table[output], 0.0, above=True) for output in outputs}


def _too_large(residuals: Residual, output: str, bound: float) -> Iterator[str]:
    sizes = np.abs(residuals.values[:, residuals.outputs.index(output)])
    if np.isnan(sizes).all():
        yield f"residual of {output} exists at no sample: samples are missing, or the record is too short"
        return
    peak = int(np.nanargmax(sizes))
    if sizes[peak] >= bound:
        reached = f"reached {_figure(sizes[peak], output)} at {residuals.time_s[peak]:.2f} s"
        yield f"residual of {output} {reached} (allowed: below {_figure(bound, output)})"


@np.errstate(over="ignore")  # the square of 1e200 is inf: above every bound
def _too_strong(residuals: Residual, output: str, bound: float) -> Iterator[str]:
    values = residuals.values[:, residuals.outputs.index(output)]
    there = values[~np.isnan(values)]
    rms = float(np.sqrt(np.mean(np.square(there)))) if len(there) else 0.0  # none: that has been told
    if rms >= bound:
        yield f"residual of {output} has an RMS of {_figure(rms, output)} (allowed: below {_figure(bound, output)})"


def _figure(value: float, output: str) -> str:
    return f"{value:.4g} {unit_of(output)}".rstrip()


def _fail_watch(
    watch: Watch, said: str, *, fault: Fault | None = None, healthy: Record | None = None, due_s: float | None = None
) -> NoReturn:
    __tracebackhide__ = True

    def write(path: Path) -> None:
        from gtmbench.report.recording.watch import write_watch_recording

        write_watch_recording(watch, path, said=said, fault=fault, healthy=healthy, due_s=due_s)

    _fail(said, write)


def _fail(said: str, write: Callable[[Path], None]) -> NoReturn:
    __tracebackhide__ = True
    raise AssertionError(f"{said}; {artefacts().record(write)}")
