"""A monitor for a study that was only given a bank: calibrated on other flights, with the study's sensors."""

from __future__ import annotations

from collections.abc import Callable

from gtmbench.bench.flight import fly
from gtmbench.detectors.bank.bank import Bank
from gtmbench.detectors.bank.detector import BankMonitor, calibrate
from gtmbench.record import Record
from gtmbench.study.flown import Flown

FLIGHTS = 12
_EXCITATION = "multisine+turbulence"
_LONGEST_S = 300.0
_SEEDS = 1_000_000_000  # calibration's seeds begin so far from the study's own


def calibrated(bank: Bank, flown: Flown, tell: Callable[[str], None], *, flights: int = FLIGHTS) -> BankMonitor:
    """Calibrate a bank on healthy flights that the study doesn't use.

    Multisine and turbulence shake them, whatever excites the study. The sensors are the study's: each of its channels'
    noise is drawn anew, with the amplitude that it has in the study (a signal-to-noise ratio gives another amplitude on
    another flight), and added to the truth.
    """
    setup = flown.setup
    duration_s = min(setup.duration_s, _LONGEST_S)
    records = []
    for number in range(flights):
        tell(f"calibration flight {number + 1}")
        seed = (setup.seed + _SEEDS + number) % 2**31
        truth = fly(setup.aircraft, _EXCITATION, duration_s, seed)
        readings = flown.sensed(_SEEDS // 1000 + number)
        noise = readings.values - flown.flight.matrix(readings.channels)
        values = truth.matrix(readings.channels) + noise[: len(truth)]
        records.append(Record(values, channels=readings.channels, sample_period_s=truth.sample_period_s))
    tell("calibrate")
    return calibrate(
        records,
        bank=bank,
        provenance={
            "aircraft": setup.aircraft,
            "excitation": _EXCITATION,
            "flights": flights,
            "duration_s": duration_s,
            "noise": f"snr {setup.snr:g} of the study's flight" if setup.snr is not None else setup.noise,
            "seed": (setup.seed + _SEEDS) % 2**31,
        },
    )
