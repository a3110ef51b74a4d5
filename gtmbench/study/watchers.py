"""What watches a study: detectors found by name, checked against its sensors before the flight, and calibrated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gtmbench.bench.aircraft import SAMPLE_PERIOD_S
from gtmbench.bench.sensor_chain import IDEAL
from gtmbench.bench.sensors import NOISES
from gtmbench.checks import shown
from gtmbench.detectors.protocol import Detector, Monitor, is_ready, is_recipe, with_provenance
from gtmbench.detectors.registry import prepared
from gtmbench.detectors.windowed_norm import DissertationOperator
from gtmbench.errors import InputError
from gtmbench.jobs.progress import Tell
from gtmbench.study.flights import Flown, check_flown
from gtmbench.study.scenario import Setup
from gtmbench.values.attitude_estimators import OWN as OWN_ATTITUDE
from gtmbench.values.channels import COMMANDS
from gtmbench.values.clock import same_period
from gtmbench.values.record import Record

FLIGHTS = 12  # of a calibration
OWN = "dissertation"
_EXCITATION = "multisine+turbulence"
_LONGEST_S = 300.0  # of such a flight
_SEEDS = 1_000_000_000  # calibration's seeds begin so far from the study's own


def own_detector(setup: Setup) -> DissertationOperator:
    """Return the detector whose settings a scenario's ``[operator]`` and ``[alarm]`` are.

    >>> own_detector(Setup()) == DissertationOperator(identify_s=(25.0, 200.0), threshold_s=(200.0, 480.0))
    True
    """
    alarm = setup.alarm
    return DissertationOperator(
        **vars(setup.operator),
        window=alarm.window,
        threshold_factor=alarm.threshold_factor,
        threshold_s=alarm.threshold_s,
    )


def resolved(detectors: Sequence[object]) -> dict[str, Any]:
    """Return what watches by names that differ: detectors, monitors, and `own_detector` for the scenarios' own."""
    if isinstance(detectors, str) or not isinstance(detectors, Sequence):
        raise InputError(f"detectors is {shown(detectors)}; give a list of them, detectors=[...]")
    named: dict[str, Any] = {}
    for source in detectors or (OWN,):
        watcher: Any = own_detector if isinstance(source, str) and source == OWN else prepared(source)
        name = OWN if watcher is own_detector else watcher.name
        twins = [other for other in named if other == name or other.startswith(f"{name} (")]
        named[f"{name} ({len(twins) + 1})" if twins else name] = watcher
    return named


Watchers = Mapping[str, Detector | Monitor]  # by name: monitors, and detectors that are yet to calibrate


def check_watchers(watchers: Watchers, setup: Setup) -> None:
    """Refuse what doesn't fit a study's sensors: before anything is flown."""
    for name, watcher in watchers.items():
        check_flown(name, watcher.channels, setup.others)
    for name, watcher in watchers.items():
        if is_ready(watcher):
            _check_period(name, watcher)
            _check_noise(name, watcher, setup)


def need_commands(watchers: Watchers) -> bool:
    """Tell whether any of them reads surface commands."""
    return any(channel in COMMANDS for watcher in watchers.values() for channel in watcher.channels)


def calibration_steps(watchers: Watchers) -> int:
    """Return of how many steps `calibrated` tells."""
    recipes = [watcher for watcher in watchers.values() if is_recipe(watcher)]
    return len(recipes) + (0 if all(map(is_tied, recipes)) else FLIGHTS)


def calibrated(watchers: Watchers, flown: Flown, tell: Tell) -> dict[str, Monitor]:
    """Calibrate what has to be, and return every monitor by name."""
    recipes = {name: watcher for name, watcher in watchers.items() if is_recipe(watcher)}
    monitors = {name: watcher for name, watcher in watchers.items() if is_ready(watcher)}
    records = [] if all(map(is_tied, recipes.values())) else _flights(flown, tell)
    for name, recipe in recipes.items():
        tell(f"calibrate {name}")
        tied = is_tied(recipe)
        monitor = recipe.calibrate([flown.sensed(0), flown.sensed(1)] if tied else records)
        monitors[name] = monitor if tied else with_provenance(monitor, _origin(flown.setup))
    return {name: monitors[name] for name in watchers}


def is_tied(detector: Detector) -> bool:
    """Whether a detector learns what excites its records, and so is calibrated on every flight anew."""
    return bool(getattr(detector, "tied_to_excitation", False))


def _check_period(name: str, monitor: Monitor) -> None:
    """Refuse a monitor of another sample period than flights have."""
    period_s = monitor.sample_period_s
    if period_s is not None and not same_period(period_s, SAMPLE_PERIOD_S):
        raise InputError(
            f"'{name}' doesn't fit: a flight is sampled every {SAMPLE_PERIOD_S:g} s, the monitor was calibrated at "
            f"{period_s:g} s; calibrate it on flights, or on logs of that rate"
        )


def _check_noise(name: str, monitor: Monitor, setup: Setup) -> None:
    """Refuse a monitor that was calibrated on other sensors: it would alarm on healthy ones, or see little."""
    was, now = monitor.provenance.get("noise"), _noise(setup)
    if isinstance(was, str) and was != now:
        stated = f'state noise = "{was}" in the scenario instead of snr, or ' if was in NOISES else ""
        raise InputError(
            f"'{name}' was calibrated on sensors with the noise '{was}', and the scenario's have '{now}': it would "
            f"alarm on healthy ones, or see little; {stated}give the detector uncalibrated, and it is calibrated on "
            "the scenario's sensors"
        )


def _noise(setup: Setup) -> str:
    """Return what noise a study's sensors have; a ratio gives another amplitude on another flight."""
    if setup.snr is None:
        return setup.noise or "none"
    return f"snr {setup.snr:g} of a flight with {setup.excitation}, {setup.duration_s:g} s"


def _flights(flown: Flown, tell: Tell) -> list[Record]:
    """Fly healthy flights that the study doesn't use, in its loop where that is closed.

    Multisine and turbulence shake them, whatever excites the study. The sensors are the study's.
    """
    setup = flown.setup
    duration_s = min(setup.duration_s, _LONGEST_S)
    records = []
    for number in range(FLIGHTS):
        tell(f"calibration flight {number + 1}")
        records.append(flown.elsewhere(_EXCITATION, duration_s, _seed(setup, number), _SEEDS // 1000 + number))
    return records


def _seed(setup: Setup, number: int) -> int:
    return int((setup.seed + _SEEDS + number) % 2**31)


def _origin(setup: Setup) -> dict[str, Any]:
    return {
        "aircraft": setup.aircraft,
        "excitation": _EXCITATION,
        "flights": FLIGHTS,
        "duration_s": min(setup.duration_s, _LONGEST_S),
        "noise": _noise(setup),
        "seed": _seed(setup, 0),
        **({"sensors": setup.sensors} if setup.sensors != IDEAL else {}),
        **({"attitude": setup.attitude} if setup.attitude != OWN_ATTITUDE else {}),
        **setup.others.facts,
        **setup.trim_point,
    }
