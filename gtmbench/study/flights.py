"""What every study begins with: one setup, trimmed and flown, its sensors, and faults put into their readings."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace

from gtmbench.bench.equilibrium import Trim
from gtmbench.bench.flight import fly
from gtmbench.bench.sensors import measure
from gtmbench.bench.trim import trim
from gtmbench.channels import COMMANDS, SENSORS, unit_of
from gtmbench.errors import InputError
from gtmbench.faults.fault import inject
from gtmbench.progress import Tell
from gtmbench.record import Record
from gtmbench.study.fault_tables import FaultSpec
from gtmbench.study.scenario import Scenario, Setup
from gtmbench.study.trial import Injection

SEED_STEP = 1000  # between the noise seeds of one study's records, so that studies with near seeds share none


@dataclass(frozen=True, kw_only=True, eq=False)
class Flown:
    """A setup that has been flown; `flight` is truth.

    Record 2 is broken in the trials, it and those after it are watched for false alarms; 0 and 1 are for identification
    and threshold. `commands`: whether surface commands come along with what the sensors read.
    """

    setup: Setup
    trim: Trim
    flight: Record = field(repr=False)
    commands: bool = False

    def sensed(self, number: int) -> Record:
        """Return what the sensors read, record 0, 1, 2, ...: the same flight, other noise."""
        setup = self.setup
        return measure(
            self.flight, snr=setup.snr, noise=setup.noise, seed=setup.seed + SEED_STEP * number, commands=self.commands
        )

    def broken(self, scenario: str, spec: FaultSpec, healthy: Record) -> Injection:
        """Put a trial's faults into healthy readings, their severities resolved against the flight."""
        first, *also = spec.faults(self.flight.between(*self.setup.severity_reference_s))
        return Injection(
            scenario=scenario,
            fault=first.kind,
            channel=first.channel,
            severity=first.severities,
            unit=unit_of(first.channel),
            injected=first,
            also=tuple(also),
            record=inject(healthy, [first, *also]),
        )


def fly_setup(setup: Setup, commands: bool, tell: Tell) -> Flown:
    """Trim and fly a setup."""
    tell("trim")
    trimmed = trim(setup.aircraft, **setup.trim_point)
    tell("fly")
    flight = fly(setup.aircraft, setup.excitation, setup.duration_s, setup.seed, **setup.trim_point)
    return Flown(setup=setup, trim=trimmed, flight=flight, commands=commands)


def check_flown(detector: str, channels: Iterable[str]) -> None:
    """Refuse, before anything is flown, a detector that needs what no flight has."""
    there = (*SENSORS, *COMMANDS)
    missing = [channel for channel in channels if channel not in there]
    if missing:
        raise InputError(f"'{detector}' needs {', '.join(missing)}, which no flight has; there are {', '.join(there)}")


def common_setup(scenarios: Sequence[Scenario], seed: int | None) -> Setup:
    """Return the setup that scenarios share, with another seed if one is given.

    Raises
    ------
    InputError
        Where there is no scenario, two have one name, or their setups differ.
    """
    if not scenarios:
        raise InputError("no scenario given")
    first = scenarios[0]
    names = [scenario.name for scenario in scenarios]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f"two scenarios go by the name '{twice[0]}'; rename one file, or run them one at a time")
    for other in scenarios[1:]:
        if other.setup != first.setup:
            settings, others = asdict(first.setup), asdict(other.setup)
            key = next(key for key in settings if settings[key] != others[key])
            raise InputError(
                f"scenarios '{first.name}' and '{other.name}' differ in {key} ({settings[key]} and {others[key]}); a "
                "study has one flight and one detector, so run them one at a time"
            )
    return first.setup if seed is None else replace(first.setup, seed=seed)
