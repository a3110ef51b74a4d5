"""What watches a campaign: detectors are calibrated once an aircraft and attitude, and files stand with the parts."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gtmbench.checks import naming
from gtmbench.detectors.base import FunctionDetector
from gtmbench.detectors.monitor_file import kind_of, load_monitor, save_monitor
from gtmbench.detectors.protocol import Detector, Monitor, is_ready, is_recipe, with_provenance
from gtmbench.detectors.registry import as_detector
from gtmbench.detectors.statistics.thresholds import Luck
from gtmbench.errors import InputError
from gtmbench.jobs.parts import Parts, hold, waiting_alone
from gtmbench.jobs.progress import Progress
from gtmbench.study.campaign.plan import Campaign
from gtmbench.study.campaign.task import Watchers
from gtmbench.study.healthy_records import CalibrationFlights
from gtmbench.study.run import knowing
from gtmbench.study.scenario import Setup
from gtmbench.study.watchers import OWN, Calibrator, is_tied, own_detector
from gtmbench.values.channels import COMMANDS, SENSORS
from gtmbench.values.record import Record

Monitors = Mapping[tuple[str, str, str], Monitor]  # by a detector's name, an aircraft and an attitude


@dataclass(frozen=True, kw_only=True)
class Named:
    """A campaign's detectors by name, found and held against its flights, and not yet calibrated."""

    detectors: Mapping[str, Detector | Monitor]
    own: bool  # whether the scenarios' own watches, too, by each one's ``[operator]`` and ``[alarm]``

    @property
    def names(self) -> tuple[str, ...]:
        """All of their names."""
        return ((OWN,) if self.own else ()) + tuple(self.detectors)

    def watchers(self, setup: Setup, calibrated: Monitors) -> Watchers:
        """Return what watches a flight; what is tied to its excitation as a recipe."""
        own: dict[str, Detector | Monitor] = {OWN: own_detector(setup)} if self.own else {}
        of = setup.aircraft, setup.attitude
        others = {name: calibrated.get((name, *of), detector) for name, detector in self.detectors.items()}
        return own | others


def named(campaign: Campaign) -> Named:
    """Find a campaign's detectors, and refuse those that don't fit its flights."""
    detectors: dict[str, Detector | Monitor] = {}
    for source in campaign.detectors:
        if source == OWN:
            continue
        detector = as_detector(source)
        if detector.name in detectors:
            raise InputError(f"two detectors have the name '{detector.name}'; rows couldn't tell them apart")
        detectors[detector.name] = detector
    found = Named(detectors=detectors, own=OWN in campaign.detectors)
    for scenario in campaign.scenarios:
        with naming(scenario.name):
            Calibrator.of(scenario.setup, found.watchers(scenario.setup, {}))
            for name, detector in detectors.items():
                if _learns(detector) and scenario.setup.noise is None:
                    raise InputError(
                        f"its noise is stated by snr, which is another one on every flight, and '{name}' is calibrated "
                        'for one; state noise = "t2" instead'
                    )
    return found


def calibrated(
    campaign: Campaign, detectors: Named, parts: Parts, *, processes: int, progress: Progress
) -> tuple[Parts, Monitors]:
    """Return every monitor by name, aircraft and attitude, as its file in the folder has it.

    What isn't there yet is calibrated. Of several shards that begin together one calibrates, and the others wait.
    """
    monitors: dict[tuple[str, str, str], Monitor] = {}
    digests: dict[str, str] = {}
    with waiting_alone(parts.folder):
        for aircraft, attitude in campaign.told_apart:
            flights = replace(campaign.calibration, aircraft=aircraft, attitude=attitude)
            records: list[Record] = []
            for name, detector in detectors.detectors.items():
                if is_recipe(detector) and is_tied(detector):
                    continue
                if is_ready(detector) and not _is_kept(detector):
                    monitors[name, aircraft, attitude] = detector
                    continue
                path = parts.folder / _file_name(name, *_file_words(campaign, aircraft, attitude))
                if not path.is_file():
                    if _learns(detector) and not records:
                        records = _flown(flights, detectors, processes, progress)
                    rate = campaign.false_alarms_per_hour
                    save_monitor(_monitor(flights, knowing(detector, attitude), records, rate, progress), path)
                monitors[name, aircraft, attitude] = load_monitor(path, _restoring(detector))
                digests[path.name] = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    return hold(parts, monitors=digests, threshold_spreads=_spreads(monitors)), monitors


def _spreads(monitors: Monitors) -> dict[str, float]:
    """Return within how many times other flights would have set 95 % of a detector's thresholds, by its name."""
    found: dict[str, float] = {}
    for (name, *_), monitor in monitors.items():
        luck = Luck.from_provenance(monitor.provenance)
        if luck is not None and np.isfinite(luck.within):
            found[name] = max(luck.within, found.get(name, 1.0))
    return found


def _restoring(detector: Detector | Monitor) -> Detector | None:
    """Return who restores a monitor's file; a bank's needs nobody, and of little flight isn't quite the recipe's."""
    return detector if is_recipe(detector) and kind_of(detector) != "bank" else None


def _learns(detector: Detector | Monitor) -> bool:
    """Whether it is calibrated on flights that shake everything, once."""
    return is_recipe(detector) and not is_tied(detector) and not isinstance(detector, FunctionDetector)


def _is_kept(monitor: Monitor) -> bool:
    """Whether a monitor can be written down; one in Python goes to the tasks as it is."""
    try:
        monitor.figures()
    except (InputError, AttributeError):
        return False
    return True


def _flown(flights: CalibrationFlights, detectors: Named, processes: int, progress: Progress) -> list[Record]:
    """Fly what all detectors are calibrated on, once."""
    wanted = {channel for detector in detectors.detectors.values() for channel in detector.channels}
    commands = [name for name in COMMANDS if name in wanted]
    return flights.sensed([*SENSORS, *flights.others.channels, *commands], processes=processes, progress=progress)


def _monitor(
    flights: CalibrationFlights,
    detector: Detector | Monitor,
    records: list[Record],
    false_alarms_per_hour: float | None,
    progress: Progress,
) -> Monitor:
    if not is_recipe(detector):
        assert is_ready(detector)
        return detector
    if isinstance(detector, FunctionDetector):
        return detector.calibrate()
    seen = [record.select(detector.channels) for record in records] if detector.channels else records
    monitor = detector.calibrate(seen, false_alarms_per_hour, progress=progress)
    return with_provenance(monitor, flights.provenance() | {"records": len(records)})


def _file_words(campaign: Campaign, aircraft: str, attitude: str) -> list[str]:
    """Return what tells the monitors of a detector apart."""
    several = [len({*values}) > 1 for values in zip(*campaign.told_apart, strict=True)]
    return [word for word, is_told in zip((Path(aircraft).name, attitude), several, strict=True) if is_told]


def _file_name(*words: str) -> str:
    """Return a name for a monitor's file: legal everywhere, another one for every detector."""
    told = "-".join(words)
    plain = re.sub(r"[^A-Za-z0-9_.-]+", "_", told)
    mark = "" if plain == told else f"-{hashlib.sha256(told.encode()).hexdigest()[:6]}"
    return f"monitor-{plain[:100]}{mark}.json"
