"""Sensors: from truth to measurements, with noise."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gtmbench.bench.sensor_chain import SensorChain
from gtmbench.checks import meant, number, whole
from gtmbench.errors import InputError
from gtmbench.values.channels import ACTUAL, CHANNELS, COMMANDS, GYROS, SENSORS
from gtmbench.values.record import FloatArray, Record

SNR_CHANNELS = (*GYROS, "beta")  # those of section 4.4; the other sensors have the T2's noise
NOISES = ("t2",)
SNR_SPAN = (1e-3, 1e9)


def measure(
    flight: Record,
    *,
    snr: float | None = None,
    noise: str | None = None,
    seed: int = 1,
    commands: bool = False,
    sensors: SensorChain | None = None,
) -> Record:
    """Return the sensor readings: the flight's sensor channels with white Gaussian noise.

    Every channel draws from a random stream of its own, named after it: adding a channel changes no other.

    Parameters
    ----------
    flight : Record
        Truth, as `fly` returns it.
    snr : float, optional
        RMS of the signal about its mean over the flight, divided by the noise's standard deviation. It applies to
        p, q, r and beta; the other sensors get the T2's noise.
    noise : "t2", optional
        Every sensor gets the noise of NASA's T2. Give either `snr` or `noise`.
    seed : int
        Of the noise.
    commands : bool
        Whether to include the surface commands, without noise.
    sensors : SensorChain, optional
        The way from motion to reading (`Aircraft.chain`); None: ideal sensors. psi must be unwrapped.

    Raises
    ------
    InputError
        If neither or both of `snr` and `noise` are given, or they are invalid.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> truth = gb.Record(np.sin(np.arange(1000) / 50), channels=["p"], sample_period_s=0.01)
    >>> added = gb.measure(truth, snr=50, seed=1)["p"] - truth["p"]
    >>> bool(0.9 < np.std(added) / (np.std(truth["p"]) / 50) < 1.1)
    True
    """
    if (snr is None) == (noise is None):
        raise InputError("give either snr (a number) or noise ('t2'), and not both")
    if noise is not None and noise not in NOISES:
        raise InputError(f"no noise '{noise}'; there is {', '.join(NOISES)}, or give snr{meant(noise, NOISES)}")
    if snr is not None:
        snr = number("snr", snr, *SNR_SPAN)
    seed = whole("seed", seed)
    columns: list[FloatArray] = []
    noises: list[FloatArray] = []
    kept = [name for name in flight.channels if name in SENSORS or name not in (*CHANNELS, *ACTUAL)]
    if not kept:
        raise InputError(f"no sensor among the channels {', '.join(flight.channels)}; there is nothing to measure")
    for name in kept:
        truth = flight[name]
        by_ratio = snr is not None and name in SNR_CHANNELS
        deviation = rms_about_mean(truth) / snr if by_ratio and snr is not None else _t2_noise(name)
        noises.append(deviation * stream(seed, name).standard_normal(len(flight)))
        columns.append(truth)
    if sensors is None:
        columns = [truth + noise for truth, noise in zip(columns, noises, strict=True)]
    else:
        motion, errors = np.column_stack(columns), np.column_stack(noises)
        columns = list(sensors.readings(motion, errors, flight.sample_period_s, kept).T)
    if commands:
        given = [name for name in COMMANDS if name in flight]
        columns += [flight[name] for name in given]
        kept += given
    return Record(
        np.column_stack(columns), channels=kept, sample_period_s=flight.sample_period_s, start_s=flight.start_s
    )


def noise_blocks(noise: str | None, seed: int, samples: int, block: int) -> Iterator[FloatArray]:
    """Give the noise of every sensor in blocks of samples, shape (block, sensors), as `measure` draws it.

    >>> [noise.shape for noise in noise_blocks("t2", 1, samples=5, block=3)]
    [(3, 13), (2, 13)]
    """
    if noise is not None and noise not in NOISES:
        raise InputError(f"no noise '{noise}'; there is {', '.join(NOISES)}, or None{meant(noise, NOISES)}")
    drawn = [(_t2_noise(name), stream(seed, name)) for name in SENSORS if noise]
    for first in range(0, samples, block):
        rows = min(block, samples - first)
        columns = [deviation * generator.standard_normal(rows) for deviation, generator in drawn]
        yield np.column_stack(columns) if columns else np.zeros((rows, len(SENSORS)))


def rms_about_mean(values: FloatArray) -> float:
    """Return the root mean square of a signal about its mean, NaN left out."""
    return float(np.nanstd(values))


def stream(seed: int, name: str) -> np.random.Generator:
    """Return the random stream of a name; other names give independent ones."""
    return np.random.default_rng([seed, *name.encode()])


def _t2_noise(name: str) -> float:
    return CHANNELS[name].noise if name in CHANNELS else 0.0
