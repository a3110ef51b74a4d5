"""What every study begins with: one setup, trimmed and flown, its sensors, and faults put into their readings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace

from gtmbench.bench.flight import fly
from gtmbench.bench.sensors import measure
from gtmbench.bench.trim import Trim, trim
from gtmbench.channels import unit_of
from gtmbench.detectors.protocol import Progress
from gtmbench.errors import InputError
from gtmbench.faults.fault import inject
from gtmbench.record import Record
from gtmbench.study.fault_tables import FaultSpec, build
from gtmbench.study.scenario import Scenario, Setup
from gtmbench.study.severity import resolve
from gtmbench.study.trial import Injection

Tell = Callable[[str], None]
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
        """Put a fault into healthy readings, its severities resolved against the flight."""
        reference = self.flight.between(*self.setup.severity_reference_s)
        shares = spec.severities.items()
        fault = build(spec, {name: resolve(share, reference, spec.channel) for name, share in shares})
        return Injection(
            scenario=scenario,
            fault=fault.kind,
            channel=fault.channel,
            severity=fault.severities,
            unit=unit_of(fault.channel),
            injected=fault,
            record=inject(healthy, fault),
        )


def fly_setup(setup: Setup, commands: bool, tell: Tell) -> Flown:
    """Trim and fly a setup."""
    tell("trim")
    trimmed = trim(setup.aircraft)
    tell("fly")
    flight = fly(setup.aircraft, setup.excitation, setup.duration_s, setup.seed)
    return Flown(setup=setup, trim=trimmed, flight=flight, commands=commands)


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
            one, two = asdict(first.setup), asdict(other.setup)
            key = next(key for key in one if one[key] != two[key])
            raise InputError(
                f"scenarios '{first.name}' and '{other.name}' differ in {key} ({one[key]} and {two[key]}); a study has "
                "one flight and one detector, so run them one at a time"
            )
    return first.setup if seed is None else replace(first.setup, seed=seed)


def counted(progress: Progress, total: int) -> Tell:
    """Return a function to be told every step as it begins; `progress` hears how many are done, and of how many."""
    done = 0

    def tell(step: str) -> None:
        nonlocal done
        progress(step, done, total)
        done += 1

    return tell
