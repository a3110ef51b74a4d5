"""A monitor of surfaces beside a control loop: it is shown readings and commands, and says which surface has failed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from gtmbench.checks import shown
from gtmbench.detectors.surfaces.blocks import BLOCK_S
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
    >>> flight = gb.fly_in_loop(duration_s=70.0, seed=5, faults=bent, sensors="ideal", watch_surfaces=watch)
    >>> [(event.kind, event.channel) for event in flight.events]
    [('surface failed', 'rudder')]
    """

    monitor: SurfaceMonitor = field(kw_only=False)

    def __post_init__(self) -> None:
        if not isinstance(self.monitor, SurfaceMonitor):
            raise InputError(f"monitor is {shown(self.monitor)}; give a calibrated one of detector 'surfaces'")

    def start(self, sample_period_s: float) -> Callable[[float, Sequence[float], Sequence[float]], Sequence[str]]:
        """Begin a flight anew, as a loop's `SurfaceWatch` does.

        Returns
        -------
        callable
            Takes the time in seconds, the readings of all sensors and what was commanded, a sample at a time, and
            returns the surfaces that have been named since.

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
        stream, rows, named = self.monitor.stream(), max(round(BLOCK_S / sample_period_s), 1), set()
        held: list[list[float]] = []
        begin_s = 0.0

        def step(time_s: float, readings: Sequence[float], commands: Sequence[float]) -> Sequence[str]:
            nonlocal begin_s
            if not held:
                begin_s = time_s
            held.append([*readings, *commands])
            if len(held) < rows:
                return ()
            chunk = Record(
                np.array(held), channels=(*SENSORS, *COMMANDS), sample_period_s=sample_period_s, start_s=begin_s
            )
            held.clear()
            told = [alarm.sensor for alarm in stream.push(chunk) if alarm.sensor is not None]
            new = [surface for surface in dict.fromkeys(told) if surface not in named]
            named.update(new)
            return new

        return step
