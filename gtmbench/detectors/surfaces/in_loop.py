"""A monitor of surfaces beside a control loop: it is shown readings and commands, and says which surface has failed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gtmbench.checks import shown
from gtmbench.detectors.surfaces.answer import rows_of
from gtmbench.detectors.surfaces.surfaces import SurfaceMonitor
from gtmbench.errors import InputError
from gtmbench.values.channels import COMMANDS, SENSORS
from gtmbench.values.clock import same_period
from gtmbench.values.record import Record


@dataclass(frozen=True, kw_only=True)
class WatchSurfaces:
    """Name surfaces that fail in a loop, which goes on as it is: nothing is replaced and nothing taken out.

    Parameters
    ----------
    monitor : SurfaceMonitor
        Of detector ``surfaces``.

    Raises
    ------
    InputError
        If it is no such monitor.

    Examples
    --------
    >>> import gtmbench as gb
    >>> flights = [gb.fly_in_loop("gtm", "multisine+turbulence", 150.0, seed, sensors="ideal") for seed in (1, 2, 3)]
    >>> monitor = gb.SurfaceDetector().calibrate([flight.readings(commands=True) for flight in flights])
    >>> bent = gb.Bias(channel="rudder", onset_s=60.0, size=2.0)
    >>> watch = gb.WatchSurfaces(monitor)
    >>> flight = gb.fly_in_loop(duration_s=80.0, seed=5, faults=bent, sensors="ideal", watch_surfaces=watch)
    >>> [(event.kind, event.channel, event.fault) for event in flight.events]  # named, and later its kind
    [('surface failed', 'rudder', None), ('surface failed', 'rudder', 'bias')]
    """

    monitor: SurfaceMonitor = field(kw_only=False)

    def __post_init__(self) -> None:
        if not isinstance(self.monitor, SurfaceMonitor):
            raise InputError(f"monitor is {shown(self.monitor)}; give a calibrated one of detector 'surfaces'")

    def start(
        self, sample_period_s: float
    ) -> Callable[[float, Sequence[float], Sequence[float]], Mapping[str, str | None]]:
        """Begin a flight anew, as a loop's `SurfaceWatch` does.

        Returns
        -------
        callable
            Takes the time in seconds, the readings of all sensors and what was commanded, a sample at a time, and
            returns the surfaces that have been named since, and those whose kind of fault has shown since: each with
            that kind, or None.

        Raises
        ------
        InputError
            If the monitor was calibrated at another sample period.
        """
        if not same_period(self.monitor.sample_period_s, sample_period_s):
            raise InputError(
                f"'{self.monitor.name}' was calibrated at {self.monitor.sample_period_s:g} s a sample, and the loop "
                f"runs at {sample_period_s:g} s; calibrate on flights of this loop"
            )
        stream, rows = self.monitor.stream(), rows_of(sample_period_s)
        named: dict[str, str | None] = {}
        held: list[list[float]] = []
        begin_s = 0.0

        def step(time_s: float, readings: Sequence[float], commands: Sequence[float]) -> Mapping[str, str | None]:
            nonlocal begin_s
            if not held:
                begin_s = time_s
            held.append([*readings, *commands])
            if len(held) < rows:
                return {}
            chunk = Record(
                np.array(held), channels=(*SENSORS, *COMMANDS), sample_period_s=sample_period_s, start_s=begin_s
            )
            held.clear()
            new: dict[str, str | None] = {}
            for alarm in stream.push(chunk):
                if alarm.sensor is None:
                    continue
                kind = alarm.judgements[-1].kind
                if alarm.sensor not in named or (kind is not None and named[alarm.sensor] is None):
                    named[alarm.sensor] = new[alarm.sensor] = kind
            return new

        return step
