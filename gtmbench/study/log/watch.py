"""A recorded flight, watched: by a monitor that is ready, or identified on one part of it or on other logs."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from gtmbench.checks import number
from gtmbench.detectors.auto import AutoDetector
from gtmbench.detectors.bank.bank import Bank, bank_of
from gtmbench.detectors.bank_detector import BankDetector, BankMonitor, calibrate
from gtmbench.detectors.installation import Installation
from gtmbench.detectors.installing import corrected, expected_of, has_motion
from gtmbench.detectors.isolation.case import ACCELEROMETERS
from gtmbench.detectors.monitor.excursions import Excursion
from gtmbench.detectors.protocol import Detector, Monitor, Watch, is_ready, is_recipe
from gtmbench.errors import InputError
from gtmbench.intake.flight_log import FlightLog
from gtmbench.intake.live import check_rate
from gtmbench.intake.open import open_log
from gtmbench.method.attitude_origin import Origin
from gtmbench.method.estimators.bayesian import Bayesian
from gtmbench.method.problem import operator_names
from gtmbench.method.pseudo_inputs import raw_needs
from gtmbench.progress import Progress, silent
from gtmbench.record import Record, Span
from gtmbench.study.calibration import prepared, with_provenance
from gtmbench.study.log.auto import bank_for_logs
from gtmbench.study.log.identified import healthy_stretches, undisturbed
from gtmbench.study.log.imus import beside, compare
from gtmbench.study.log.origin import (
    FROM_LOG,
    check_attitude,
    origin_in_log,
    origin_in_logs,
    rests_on_attitude,
    with_origin,
)
from gtmbench.study.log.records import first_part, healthy_spans, open_for, outside, whole_s, within, without
from gtmbench.study.log.regime import Regime
from gtmbench.study.log.self_check.check import (
    ALL,
    IDENTIFIED,
    WATCHED,
    Part,
    SelfCheck,
    check_identified,
    check_watched,
    check_wiring,
    rests_on_motion,
)
from gtmbench.study.log.self_check.motion import ANGLES, GYROS
from gtmbench.study.log.starts import steady
from gtmbench.study.log.watched import WatchedLog

_FASTEST_HZ = 100.0  # at which anything is identified: faster logs are brought to it
_RATE, _RATE_OF_ENERGY = 0.002, 1.0  # false alarms an hour, wanted where nobody says
_WIDE = 3.0  # spread of a residual beyond which little shows
_MUCH = 0.1  # of the time
_OTHER_NOISE = 3.0  # times the calibrated level, or a part of it, that is worth a word


def bank_between(inputs: Sequence[str], outputs: Sequence[str], *, look_s: float = 0.5) -> Bank:
    """Return a bank of operators from some channels to others, each judged by the energy of its residual.

    Parameters
    ----------
    inputs, outputs : sequence of str
        Pseudo inputs (channels, or names of `PSEUDO_INPUTS`) and pseudo outputs.
    look_s : float
        r Ts and d Ts: how far they look back and ahead.

    Examples
    --------
    >>> import gtmbench as gb
    >>> bank = gb.bank_between(["p", "q", "beta"], ["r"])
    >>> bank.name, bank.suspects
    ('[p q beta] -> r', ('r', 'p', 'q', 'beta'))
    """
    u, y = operator_names(inputs, outputs)
    look = {"look_back_s": look_s, "look_ahead_s": look_s}
    suspects = dict.fromkeys(raw for name in (*y, *u) for raw in sorted(raw_needs(name)))
    table = {
        "title": "identified on the log",
        "suspects": list(suspects),
        "residuals": [{"output": output, "inputs": list(u), **look} for output in y],
        "alarm": {"statistic": "energy", "windows_s": [0.5, 2.0], "two_sided": False},
    }
    return bank_of(f"[{' '.join(u)}] -> {' '.join(y)}", table)


def watch_log(
    path: str | Path,
    detector: Detector | Monitor | Bank | str | Path,
    *,
    healthy: Sequence[Span | str | Path] = (),
    mapping: Sequence[str] = (),
    rate_hz: float | None = None,
    false_alarms_per_hour: float | None = None,
    attitude: str = FROM_LOG,
    progress: Progress = silent,
) -> WatchedLog:
    """Open a recorded flight and watch it.

    A monitor (or a plain function) watches all of it. A detector is first calibrated on what is `healthy`, a bank with
    caution, as a short record wants it, and watches the rest. A log that isn't what it expects isn't watched: `check`
    says why.

    Parameters
    ----------
    path : str or Path
        As `open_log` takes it.
    detector : Detector, Monitor, Bank, or what names one
        As `find_detector` takes it; ``auto`` is the bank that the channels of the log, and of the healthy ones, allow.
    healthy : sequence of (start, end), str or Path
        For a detector: spans of this log in seconds (ends may be infinite), or other logs, read alike. Without any, the
        first 40 % of this log, 300 s at most.
    mapping : sequence of str
        As `open_log` takes it.
    rate_hz : float, optional
        For a detector: to resample to; without it the slowest channel's, 100 at most. A monitor has its own.
    false_alarms_per_hour : float, optional
        Wanted of a detector; of a bank 0.002, and 1 of one that is judged by its residuals' energy, as
        `bank_between`'s: most of that is the model's error, whose tail half a minute doesn't bound further.
    attitude : str
        For a bank that predicts gyros from the attitude: whether the gyros drive it, ``driven``, as an estimator's, or
        it is of its ``own``. ``auto`` is what the format documents, else what the samples show: driven where they don't
        show that it is of its own. A monitor keeps what it was calibrated with.
    progress : callable
        Told the step, how many are done, and of how many.

    Raises
    ------
    InputError
        Where a log can't be read, lacks channels, or holds too little that is healthy.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> noise = np.random.default_rng(1).standard_normal((1500, 2))
    >>> record = gb.Record(noise @ [[1.0, 1.0], [0.0, 0.1]], channels=["p", "q"], sample_period_s=0.04)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     gb.write_log(record, Path(folder, "flight.csv"))
    ...     watched = gb.watch_log(Path(folder, "flight.csv"), gb.bank_between(["p"], ["q"]), healthy=[(0.0, 30.0)])
    >>> watched.outcome, watched.identified_s
    (<Outcome.HEALTHY: 0>, ((0.0, 30.0),))
    """
    watcher = prepared(detector)
    if is_ready(watcher):
        if check_attitude(attitude) != FROM_LOG:
            raise InputError(
                f"attitude is '{attitude}'; a calibrated monitor keeps what it was calibrated with, so leave it out, "
                "or give a bank"
            )
        return _by_monitor(path, watcher, healthy, mapping, rate_hz, progress)
    assert is_recipe(watcher)
    watcher, attitude_of_log, unwatched = _for_logs(watcher, path, healthy, mapping, attitude)
    rate = _rate(watcher, false_alarms_per_hour)
    log = _opened(path, watcher, mapping, rate_hz)
    same_rate_hz = 1.0 / log.sample_period_s
    paths = [_other(given, log) for given in healthy if isinstance(given, (str, Path))]
    spans = healthy_spans(log, [given for given in healthy if not isinstance(given, (str, Path))])
    reasons = list(unwatched)
    if not healthy:
        spans = (first_part(log),)
        reasons.append(f"{spans[0][0]:g}..{spans[0][1]:g} s were taken as healthy, for nothing else was said")
    others = [open_for(other, watcher, mapping=mapping, rate_hz=same_rate_hz) for other in paths]
    healthy_of = [(other, other.segments) for other in others] + ([(log, within(log, spans))] if spans else [])
    stretches, too_short = healthy_stretches(healthy_of, watcher.channels)
    reasons += too_short
    origin: dict[str, object] = {
        "source": "logs",
        "logs": [{"name": other.path.name} for other in others] + [{"name": log.path.name}] * bool(spans),
        "healthy_s": [list(span) for span in spans],
    }
    parts = [_part(watcher, other, [whole_s(other)], mapping) for other in others]
    if spans:
        parts.append(_part(watcher, log, spans, mapping))
    check = check_wiring(watcher, parts, IDENTIFIED)
    if not check.stops:
        stretches = undisturbed(watcher, stretches)
        reasons += stretches.reasons
        moved = (record for part in parts for record in outside(part.motion, stretches.left_out_of(part.log)))
        origin["regime"] = dict(Regime.of(moved).limits)
        ready = _calibrated(watcher, stretches.records, rate, origin, progress)
        check = check_identified(check, ready, stretches.records)
    if spans and not check.causes and (check.stops or any(not each.is_shown for each in check.explained)):
        whole = check_wiring(watcher, [_part(watcher, log, [whole_s(log)], mapping)], ALL)
        check = replace(whole, explained=check.explained) if whole.causes else check
    if check.stops:
        return WatchedLog(
            log=log,
            monitor=watcher if not check.explained else ready,
            identified_s=spans if check.explained else (),
            watches=(),
            reasons=(*check.stops, *reasons),
            check=check,
            left_out=stretches.left_out,
            attitude=attitude_of_log,
        )
    before = stretches.records[-1] if spans else None
    watched = _watched(
        log, ready, mapping, identified_s=spans, before=before, reasons=reasons, check=check, progress=progress
    )
    return replace(watched, left_out=stretches.left_out, attitude=attitude_of_log)


def _for_logs(
    watcher: Detector,
    path: str | Path,
    healthy: Sequence[Span | str | Path],
    mapping: Sequence[str],
    attitude: str,
) -> tuple[Detector, Origin | None, tuple[str, ...]]:
    """Return a recipe as logs allow it and their attitude wants it, what that is, and which gyros aren't watched."""
    logs = [Path(path), *(Path(given) for given in healthy if isinstance(given, (str, Path)))]
    if check_attitude(attitude) == FROM_LOG and not (isinstance(watcher, AutoDetector) or rests_on_attitude(watcher)):
        return watcher, None, ()
    own = [given for given in healthy if not isinstance(given, (str, Path))]
    origin = origin_in_logs(logs, mapping, attitude=attitude, spans=own if healthy else None)
    unwatched: tuple[str, ...] = ()
    if isinstance(watcher, AutoDetector):
        watcher, unwatched = bank_for_logs(logs, mapping, origin)
    if not isinstance(watcher, BankDetector) or not rests_on_attitude(watcher):
        return watcher, None, unwatched
    return with_origin(watcher, origin), origin, unwatched


def _by_monitor(
    path: str | Path,
    monitor: Monitor,
    healthy: Sequence[object],
    mapping: Sequence[str],
    rate_hz: float | None,
    progress: Progress,
) -> WatchedLog:
    """Let a monitor that is ready watch all of a log, at its own rate."""
    if healthy:
        raise InputError("a calibrated monitor isn't identified anew; leave out what is healthy, or give a bank")
    own_hz = None if monitor.sample_period_s is None else 1.0 / monitor.sample_period_s
    if own_hz is not None and rate_hz is not None:
        raise InputError(
            f"a rate of {rate_hz:g} Hz is given, and the monitor has its own, {own_hz:g} Hz; leave the rate out, or "
            "give a bank"
        )
    log = open_for(path, monitor, mapping=mapping, rate_hz=rate_hz or own_hz)
    for source in log.sources:
        if monitor.sample_period_s and source.period_s and source.channel in monitor.channels:
            check_rate(source.period_s, monitor.sample_period_s, f"{path}: samples of {source.channel}")
    told, reasons = _as_calibrated(monitor, log)
    watched = _watched(log, monitor, mapping, identified_s=(), reasons=reasons, check=SelfCheck(), progress=progress)
    return replace(watched, attitude=told)


def _as_calibrated(monitor: Monitor, log: FlightLog) -> tuple[Origin | None, tuple[str, ...]]:
    """Return whose attitude a monitor was calibrated for, and a word where the log shows that its own is another."""
    if not rests_on_attitude(monitor):
        return None, ()
    assert isinstance(monitor, BankMonitor)
    told = Origin(is_driven=monitor.bank.attitude_from_gyros, why="as the monitor was calibrated")
    seen = origin_in_log(log)
    if seen.is_assumed or seen.is_driven == told.is_driven:
        return told, ()
    names = {True: "one that the gyros drive", False: "one of its own"}
    return told, (
        f"the log's attitude is {names[seen.is_driven]} ({seen.why}), and the monitor was calibrated for "
        f"{names[told.is_driven]}: calibrate one for such logs",
    )


def _rate(detector: Detector, wanted: float | None) -> float | None:
    """Return the false-alarm rate to ask for; of a detector that isn't a bank, only what somebody wants."""
    usual = None
    if isinstance(detector, BankDetector):
        usual = _RATE_OF_ENERGY if detector.bank.statistic.name == "energy" else _RATE
    asked = usual if wanted is None else wanted
    return None if asked is None else number("false_alarms_per_hour", asked, 1e-9, 1e3)


def _calibrated(
    detector: Detector,
    records: Sequence[Record],
    rate: float | None,
    origin: Mapping[str, object],
    progress: Progress,
) -> Monitor:
    """Calibrate on a log's healthy stretches: a bank always with caution, for one flight excites few directions."""
    if isinstance(detector, BankDetector):
        return calibrate(
            records,
            bank=detector.bank,
            false_alarms_per_hour=rate,
            estimator=Bayesian(),
            provenance=origin,
            progress=progress,
        )
    return with_provenance(detector.calibrate(records, rate, progress=progress), origin)


def _opened(path: str | Path, detector: Detector, mapping: Sequence[str], rate_hz: float | None) -> FlightLog:
    log = open_for(path, detector, mapping=mapping, rate_hz=rate_hz)
    if rate_hz is None and log.sample_period_s < 0.99 / _FASTEST_HZ:
        log = open_for(path, detector, mapping=mapping, rate_hz=_FASTEST_HZ)
    return log


def _other(path: str | Path, log: FlightLog) -> Path:
    """Return the path of another log, and refuse this one: it would be watched by what it taught."""
    other = Path(path)
    if other.exists() and other.samefile(log.path):
        raise InputError(f"{other} is the log that is watched; give a span of it that is healthy, or another log")
    return other


def _watched(
    log: FlightLog,
    monitor: Monitor,
    mapping: Sequence[str],
    *,
    identified_s: Sequence[Span],
    before: Record | None = None,
    reasons: Sequence[str],
    check: SelfCheck,
    progress: Progress,
) -> WatchedLog:
    """Watch every segment of a log but the spans that the monitor was identified on; the noise was there `before`.

    Of a log that the monitor wasn't identified on, wiring is checked first.
    """
    parts = without(log, identified_s)
    left = [(each.start_s, each.end_s) for each in parts]
    rest = _part(monitor, log, left, mapping)
    installation = None
    if parts and not identified_s and has_motion(monitor):
        parts, installation = corrected(parts, expected_of(monitor))
        rest = replace(rest, records=parts, motion=parts if rest.motion else ())
    if not identified_s:
        wired = check_wiring(monitor, [rest], WATCHED)
        check = replace(wired, explained=check.explained)
    watches: list[Watch] = []
    if check.stops:
        parts = []
    excursions = _excursions(monitor, rest)
    done_s, total_s = 0.0, sum(len(part) for part in parts) * log.sample_period_s
    for part in parts:
        tell = _seconds(progress, done_s, total_s, part.sample_period_s)
        tell("watch", 0, len(part))
        if isinstance(monitor, BankMonitor):
            watch = monitor.watch(part, outside=excursions, before=before, progress=tell)
            watches.append(steady(monitor, watch, before))
        else:
            watches.append(monitor.watch(part))
        done_s += len(part) * part.sample_period_s
    comparison = None
    if not check.stops and watches and len(log.imus) > 1:
        progress("compare", round(total_s), round(total_s))
        healthy = identified_s or (first_part(log),)
        comparison = compare(log, healthy=healthy, excursions=excursions, mapping=mapping)
        watches = beside(watches, comparison)
    progress("watched", round(total_s), round(total_s))
    if not check.stops:
        check = check_watched(check, monitor, watches, log, left)
    return WatchedLog(
        log=log,
        monitor=monitor,
        identified_s=tuple(identified_s),
        watches=tuple(watches),
        excursions=excursions,
        reasons=(*check.stops, *check.doubts, *_limits(watches, check), *_installed(installation), *reasons),
        check=check,
        installation=installation,
        comparison=comparison,
    )


def _installed(installation: Installation | None) -> tuple[str, ...]:
    if installation is None or not installation.said:
        return ()
    said = ", ".join(installation.said)
    return (
        f"{said}: taken for how the sensors are installed, and undone; a fault from the first sample on is part of it",
    )


def _seconds(progress: Progress, before_s: float, total_s: float, period_s: float) -> Progress:
    """Return a function to be told rows of a part of a log; `progress` hears seconds of all that is watched."""

    def tell(step: str, rows: int, _of: int) -> None:
        progress(step, round(before_s + rows * period_s), round(total_s))

    return tell


def _excursions(monitor: Monitor, left: Part) -> tuple[Excursion, ...]:
    """Return the stretches that are beyond what a bank was identified on, and those that are watched, in time."""
    if not isinstance(monitor, BankMonitor):
        return ()
    regime = Regime.told(monitor.provenance)
    return tuple(excursion for record in left.motion for excursion in regime.excursions(record, left.log.events))


def _part(watcher: Detector | Monitor, log: FlightLog, spans: Sequence[Span], mapping: Sequence[str]) -> Part:
    """Return the part of a log in some spans, with its gyros and its whole attitude, read again if they weren't."""
    moving: FlightLog | None = log
    if not rests_on_motion(watcher):
        moving = None
    elif not {*GYROS, *ANGLES} <= set(log.channels):
        moving = None
        with contextlib.suppress(InputError):
            rate_hz = 1.0 / log.sample_period_s
            needs = (*GYROS, *ANGLES)
            moving = open_log(log.path, mapping=mapping, rate_hz=rate_hz, needs=needs, witnesses=ACCELEROMETERS)
    records = within(log, spans)
    if moving is None:
        return Part(log=log, records=records, spans=spans)
    motion = records if moving is log else within(moving, spans)
    return Part(log=log, records=records, spans=spans, motion=motion, sources=moving.sources)


def _other_noise(watches: Sequence[Watch]) -> list[str]:
    """Say whose noise is far from what the monitor was calibrated for."""
    far: dict[str, float] = {}
    for watch in watches:
        for name, level in watch.noise_levels.items():
            if not 1.0 / _OTHER_NOISE < level < _OTHER_NOISE:
                far.setdefault(name, level)
    if not far:
        return []
    levels = ", ".join(f"{name} {level:.2g}" for name, level in far.items())
    return [
        f"the noise is another one than calibrated for ({levels} times as strong); it is judged as it was learnt here"
    ]


def _limits(watches: Sequence[Watch], check: SelfCheck) -> list[str]:
    """Say why nothing was seen, or what limits what was."""
    if check.stops:
        return []
    if not watches:
        return ["nothing of the log is left to watch"]
    reasons = [
        f"the score of {name} stood above its threshold from {watch.record.start_s:.2f} s on and never came down, so "
        "nothing is told of it: a fault from the beginning, or sensors that it wasn't calibrated for"
        for watch in watches
        for name, score in watch.scores.items()
        if score.is_stuck_above
    ]
    if not reasons and not any(watch.armed_hours for watch in watches):
        return ["what is left to watch is too short"]
    reasons += _other_noise(watches)
    wide = [np.logical_or.reduce([of > _WIDE for of in watch.widening.values()]) for watch in watches if watch.widening]
    share = float(np.concatenate(wide).mean()) if wide else 0.0
    if share >= _MUCH:
        reasons.append(
            f"{100.0 * share:.0f} % of the time the motion was beyond what identification held; faults show less there"
        )
    return reasons
