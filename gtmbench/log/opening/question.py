"""What is asked of a log: who watches it, what of it is healthy, how its columns are named. Nothing is read yet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from gtmbench.checks import number
from gtmbench.detectors.assumptions import basis_of
from gtmbench.detectors.bank.bank import Bank
from gtmbench.detectors.protocol import Detector, Monitor, is_ready
from gtmbench.detectors.registry import prepared
from gtmbench.errors import InputError
from gtmbench.log.opening.driven_attitude import check_attitude
from gtmbench.values.channels import COMMANDS
from gtmbench.values.record import Span
from gtmbench.verdict.scope import JUDGED, Scope, asked_sensors


@dataclass(frozen=True, kw_only=True, eq=False)
class Asked:
    """A question about a log."""

    path: Path
    watcher: Detector | Monitor  # a monitor watches all of the log; a detector is calibrated on what is healthy first
    spans: tuple[Span, ...]  # what of this log is healthy, in seconds, as it was given
    others: tuple[Path, ...]  # other logs, which are healthy
    mapping: tuple[str, ...]
    rate_hz: float | None
    false_alarms_per_hour: float | None
    attitude: str
    # the sensors that the verdict speaks for, as they were named; None for the usual ones
    judge: tuple[str, ...] | None = None
    limits: tuple[str, ...] = ()  # sizes that may not hide, as they were typed
    judged: float = JUDGED  # the least share of the time in motion that each is judged for

    def scope(self, there: Sequence[str], usual: Sequence[str], held: Sequence[str]) -> Scope:
        """Return what is asked of a log with some sensors, of which some are the usual ones; all are those held."""
        sensors = asked_sensors(self.judge, there, usual, held)
        return Scope(sensors=sensors, judged=self.judged).with_limits(self.limits)

    def mapped(self, mapping: Sequence[str]) -> Asked:
        """Return the question about a log of which some channels are mapped otherwise."""
        names = {text.partition("=")[0].strip() for text in mapping}
        kept = (text for text in self.mapping if text.partition("=")[0].strip() not in names)
        return replace(self, mapping=(*kept, *mapping))

    @property
    def asks_surfaces(self) -> bool:
        """Whether it is asked whether a surface failed."""
        return self.judge is not None and bool({"surfaces", *COMMANDS} & {name.strip() for name in self.judge})

    @property
    def says_healthy(self) -> bool:
        """Whether somebody said what is healthy."""
        return bool(self.spans or self.others)


def asked(
    path: str | Path,
    detector: Detector | Monitor | Bank | str | Path,
    *,
    healthy: Sequence[Span | str | Path],
    mapping: Sequence[str],
    rate_hz: float | None,
    false_alarms_per_hour: float | None,
    attitude: str,
    judge: str | Sequence[str] | None = None,
    limits: Sequence[str] = (),
    judged: float = JUDGED,
) -> Asked:
    """Return what is asked, as `watch_log` takes it."""
    watcher = prepared(detector)
    if basis_of(watcher).is_whole:
        if healthy:
            raise InputError(f"'{watcher.name}' judges the whole log and learns nothing; leave out what is healthy")
        watcher = prepared(watcher.name)  # a saved one knows nothing more
    check_attitude(attitude)
    Scope(sensors=()).with_limits(limits)  # a limit that is none is refused before anything is read
    if is_ready(watcher):
        _check_ready(watcher, healthy, rate_hz)
    others = tuple(Path(given) for given in healthy if isinstance(given, (str, Path)))
    for other in others:
        if other.exists() and Path(path).exists() and other.samefile(path):
            raise InputError(f"{other} is the log that is watched; give a span of it that is healthy, or another log")
    wanted = false_alarms_per_hour
    return Asked(
        path=Path(path),
        watcher=watcher,
        spans=tuple(given for given in healthy if not isinstance(given, (str, Path))),
        others=others,
        mapping=tuple(mapping),
        rate_hz=rate_hz,
        false_alarms_per_hour=None if wanted is None else number("false_alarms_per_hour", wanted, 1e-9, 1e3),
        attitude=attitude,
        judge=None if judge is None else tuple(judge.split(",") if isinstance(judge, str) else judge),
        limits=tuple(limits),
        judged=number("judged", judged, 0.0, 1.0),
    )


def _check_ready(monitor: Monitor, healthy: Sequence[object], rate_hz: float | None) -> None:
    """Refuse what a calibrated monitor has its own of."""
    if healthy:
        raise InputError("a calibrated monitor isn't identified anew; leave out what is healthy, or give a bank")
    if monitor.sample_period_s is not None and rate_hz is not None:
        raise InputError(
            f"a rate of {rate_hz:g} Hz is given, and the monitor has its own, {1.0 / monitor.sample_period_s:g} Hz; "
            "leave the rate out, or give a bank"
        )
