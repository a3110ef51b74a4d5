"""Sensors: from truth to measurements, with noise; and healthy but imperfect ones, which a detector has to live with.

They have a bias, a wandering bias, a lag, and they round.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from gtmbench.bench.sensor_chain import SensorChain
from gtmbench.checks import meant, names, number, shown, whole
from gtmbench.errors import InputError
from gtmbench.faults.distortions import lagged, quantised, random_walk
from gtmbench.values.channels import ACTUAL, CHANNELS, COMMANDS, GYROS, SENSORS
from gtmbench.values.record import FloatArray, Record, check_record, with_columns

SNR_CHANNELS = (*GYROS, "beta")  # those of section 4.4; the other sensors have the T2's noise
NOISES = ("t2",)
SNR_SPAN = (1e-3, 1e9)  # of what may be asked for


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
    kept = [name for name in flight.channels if name in SENSORS or name not in (*CHANNELS, *ACTUAL)]
    if not kept:
        raise InputError(f"no sensor among the channels {', '.join(flight.channels)}; there is nothing to measure")
    deviations = [
        _t2_noise(name) if snr is None or name not in SNR_CHANNELS else rms_about_mean(flight[name]) / snr
        for name in kept
    ]
    motion, drawn = flight.matrix(kept), [stream(seed, name).standard_normal(len(flight)) for name in kept]
    noises = np.column_stack(drawn) * deviations
    values = motion + noises if sensors is None else sensors.readings(motion, noises, flight.sample_period_s, kept)
    given = [name for name in COMMANDS if commands and name in flight]
    readings = Record(values, channels=kept, sample_period_s=flight.sample_period_s, start_s=flight.start_s)
    return with_columns(readings, given, [flight.matrix(given)])


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


LARGEST = 1e9  # of every figure; far beyond any sensor, and far from where numbers overflow
SMALLEST_QUANTUM = 1e-9  # a finer one doesn't round, it costs digits

# how the command line names a field, and its unit there: gyros
_UNITS = {"bias": "deg/s", "wander": "deg/s per sqrt(s)", "lag": "s", "quantum": "deg/s"}


@dataclass(frozen=True, kw_only=True)
class Imperfections:
    """The imperfections of a healthy sensor, in its channel's unit; 0 is perfect.

    Parameters
    ----------
    bias : float
        Standard deviation of the turn-on bias, which stays the same over a record.
    wander : float
        Standard deviation that a wandering bias (a random walk) gains in 1 s, in unit per sqrt(s). After T seconds it
        is wander sqrt(T). The walk starts at zero.
    lag_s : float
        Time constant of a first-order lag, tau y' + y = u, in seconds; the bandwidth is 1/(2 pi lag_s) Hz.
    quantum : float
        The readings are whole multiples of this.

    Raises
    ------
    InputError
        If a figure is negative or no number, or implausibly large or fine.

    Examples
    --------
    >>> import gtmbench as gb
    >>> str(gb.Imperfections(bias=0.5, lag_s=0.005)), str(gb.Imperfections())
    ('bias 0.5, lag 0.005 s', 'perfect')
    """

    bias: float = 0.0
    wander: float = 0.0
    lag_s: float = 0.0
    quantum: float = 0.0

    def __post_init__(self) -> None:
        for each in fields(self):
            object.__setattr__(self, each.name, number(each.name, getattr(self, each.name), 0.0, LARGEST))
        if 0.0 < self.quantum < SMALLEST_QUANTUM:
            raise InputError(f"quantum is {self.quantum:g}; it must be 0 (none) or {SMALLEST_QUANTUM:g} or more")

    def __str__(self) -> str:
        figures = {"bias": self.bias, "wander": self.wander, "lag": self.lag_s, "quantum": self.quantum}
        seconds = {"lag": " s"}
        said = [
            f"{key} {str(value).removesuffix('.0')}{seconds.get(key, '')}" for key, value in figures.items() if value
        ]
        return ", ".join(said) or "perfect"


def imperfect(
    record: Record, imperfections: Imperfections, *, channels: Sequence[str] = GYROS, seed: int = 1
) -> Record:
    """Return the readings of imperfect sensors: the named channels with lag, bias, wander and rounding, in that order.

    The lag acts on the record as it is given. Where noise was added before, it passes the lag, too: at 100 Hz, a lag of
    5 ms leaves 0.68 of white noise's standard deviation. Faults come afterwards: inject them into what this returns.

    Every channel draws bias and wander from random streams of its own, named after it: adding a channel changes no
    other, and none of them is that of `measure`. A missing sample (NaN) stays missing and is passed over: the lag holds
    its state meanwhile, the bias wanders on.

    Parameters
    ----------
    record : Record
        Readings of perfect sensors, with or without noise.
    imperfections : Imperfections
        The imperfections of all named channels, each in its own unit.
    channels : sequence of str
        Which channels; the others stay as they are.
    seed : int
        Seed of bias and wander.

    Raises
    ------
    InputError
        If the record lacks a channel, or an argument is invalid.

    Examples
    --------
    >>> import gtmbench as gb
    >>> record = gb.Record([0.3, 0.6, 0.9], channels=["p"], sample_period_s=0.01)
    >>> gb.imperfect(record, gb.Imperfections(quantum=0.5), channels=["p"])["p"]
    array([0.5, 0.5, 1. ])
    """
    check_record(record)
    if not isinstance(imperfections, Imperfections):
        raise InputError(f"{imperfections!r} is no set of imperfections; give one such as Imperfections(bias=0.5)")
    seed = whole("seed", seed)
    chosen = names("channels", channels)
    record.columns(chosen)  # all of them, before any work is done
    for name in chosen:
        record = record.replace(name, _imperfect(record[name], imperfections, record.sample_period_s, name, seed))
    return record


def drawn(imperfections: Imperfections, *, seed: int = 1) -> Imperfections:
    """Return one sensor of a class: its lag anything up to the one stated; bias and wander `imperfect` draws itself.

    Calibrate on sensors so drawn for a monitor that tolerates the class: a lag that all have alike is learnt as part of
    the aircraft and tolerates no other.

    >>> 0.0 <= drawn(Imperfections(lag_s=0.005), seed=3).lag_s <= 0.005
    True
    """
    share = stream(whole("seed", seed), "imperfections\0lag").random()
    return replace(imperfections, lag_s=imperfections.lag_s * float(share))


def parse_imperfections(text: str) -> Imperfections:
    """Return the imperfections of gyros that a command line states.

    Keys are bias (deg/s), wander (deg/s per sqrt(s)), lag (s) and quantum (deg/s); those left out are zero.

    >>> parse_imperfections("bias=0.5,lag=0.005")
    Imperfections(bias=0.5, wander=0.0, lag_s=0.005, quantum=0.0)
    """
    if not isinstance(text, str):
        raise InputError(f"imperfections are {shown(text)}; give them as text such as bias=0.5,lag=0.005")
    legal = ", ".join(f"{key} ({unit})" for key, unit in _UNITS.items())
    figures: dict[str, float] = {}
    for part in text.split(","):
        key, equals, value = (piece.strip() for piece in part.partition("="))
        if not equals or key not in _UNITS:
            raise InputError(
                f"imperfection {shown(part.strip())} isn't key=number; the keys are {legal}{meant(key, _UNITS)}"
            )
        if key in figures:
            raise InputError(f"imperfection '{key}' is given twice; give it once")
        try:
            figure = float(value)
        except ValueError as error:
            raise InputError(f"imperfection {key} is {shown(value)}; it must be a number, in {_UNITS[key]}") from error
        figures[key] = number(f"imperfection {key}", figure, 0.0, LARGEST)
    return Imperfections(**{"lag_s" if key == "lag" else key: figure for key, figure in figures.items()})


def _imperfect(y: FloatArray, by: Imperfections, sample_period_s: float, name: str, seed: int) -> FloatArray:
    """Return what an imperfect sensor makes of one channel."""
    if by.lag_s:
        y, _ = lagged(y, by.lag_s, sample_period_s)
    # names of channels are printable: none has a zero byte, so no channel's noise comes from these streams
    if by.bias:
        y = y + by.bias * stream(seed, f"{name}\0bias").standard_normal()
    if by.wander:
        wandering, _ = random_walk(stream(seed, f"{name}\0wander").standard_normal(len(y)), by.wander, sample_period_s)
        y = y + wandering
    return quantised(y, by.quantum) if by.quantum else y
