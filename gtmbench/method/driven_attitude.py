"""An attitude's estimator, found out from the samples: whether the gyros drive it, and how long it trusts them.

An attitude that integrates the gyros holds their noise; one of a vertical gyro, of motion capture or of a simulation
doesn't. So a gyro's noise is looked for in the attitude's rate, at frequencies at which the motion is small.

How long it trusts them is its time constant. An estimator turns its angle x by the gyros y and pulls it to its
references z: x' = f(x, y - b) + (z - x) / tau. So

    e = x' - f(x, y) = (z - x) / tau - f(x, b)

is what the references and a gyro's bias b add to the angle's rate. Where accelerometers tell the references, z - x is
known, and the regression of e on it has the slope 1/tau. The gyros' noise is no error of it, for x has integrated it.

A slope is no proof. An estimator whose references are only partly the accelerometers', z = x_0 + g (z_a - x_0) with x_0
the true angle, has e = (g (z_a - x) - (1 - g) d) / tau with d = x - x_0, the integral of e. That integral is a second
regressor, and unless its slope is next to nothing, accelerometers don't tell the references and no time constant is
told. It is what an estimator does that is corrected by GPS, or that allows for turns.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from gtmbench.checks import listed
from gtmbench.method.rate_spectra import Gain, RateSpectra, spectra_of
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, GYROS
from gtmbench.values.record import BoolArray, FloatArray, Record

_HALF_OCTAVE = 2.0**0.5  # a band's ends, one over the other
_LOWEST_HZ = 0.5  # of the frequencies that are compared
_FEWEST = 2  # gyros whose noise has to be missing in the attitude
_SLOWEST_HZ = 90.0  # of the sample rate: in slower logs noise and vibration fold back, into the gyros alone
_MOST = 0.1  # of its noise may stand in an own attitude
_ERRORS = 2.0  # standard errors, by which that is kept
_FOLLOWS = 0.85  # of what a gyro reads is motion, so that it shows that the attitude's rate passes it
_APART, _OF_MOTION = 0.05, 0.05  # by which a gain may differ from the expected one, and by such a part of that
_TURN = 16.0  # a delay is known to such a part of a period
_LATE_ERRORS = 5.0  # standard errors of a gain, of which the greatest of many delays is taken
_FLAT = 1.2  # times the power in a half octave has the next one, of noise
_NOTHING_FOLDS_HZ = 180.0  # of the sample rate, little vibration folds back, and a gyro's own filter may show
_UNSEEN = 0.1  # a standard error that tells nothing
_STANDS, _SURE = 0.5, 0.15  # a share of the gyro in the attitude, and its standard error, that show that it drives it
_OF_GRID = 4.0  # times the power of its readings' steps is noise


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Where an attitude comes from."""

    is_driven: bool  # whether the gyros drive it, so that a gyro's fault bends it
    why: str  # what was measured, what the format documents, or that driven is assumed, for nothing shows it
    # by gyro, where it was measured: how much of its noise, or of all that it reads at high frequencies where its noise
    # isn't seen to be missing, stands in the gyro less the attitude's rate
    shares: Mapping[str, float] = field(default_factory=dict)
    is_assumed: bool = False  # whether it is taken for driven because nothing shows that it is of its own

    @property
    def may_bend(self) -> bool:
        """Whether it is known to be driven, or what every gyro reads, noise included, stands in its rate."""
        return self.is_driven and (not self.is_assumed or {*GYROS} <= {*self.shares})


@dataclass(frozen=True, kw_only=True)
class _Missing:
    """That a gyro's noise is missing in the attitude: which share, and where."""

    share: float
    low_hz: float
    high_hz: float


def origin_of(records: Sequence[Record], documented: bool | None = None) -> Origin:
    """Tell whether the gyros drive the attitude of some records.

    What a format documents is believed. Else an attitude is said to be of its own only where, of two gyros or more, the
    noise is seen to be missing in the attitude's rate; where nothing is seen, it is taken for driven, as most are.

    Missing means: in an octave in which the gyro's power is flat, as noise is, the rate's regression on the gyro leaves
    less than a tenth, whatever the delay up to a quarter of a second. And below that octave the rate has to follow the
    gyro by just what it reads above that noise, in quiet and in loud windows, up to where nearly all is motion: an
    attitude that was low-passed follows it by another curve, or each frequency by another delay. Slower than 90 Hz
    nothing is said to be of its own, for what a gyro's samples fold back from higher frequencies is missing in a driven
    attitude, too.

    `records`: p, q, r in deg/s, phi, theta, psi in deg; at one rate, the gyros as fast as they can be had. Of others
    nothing can be told. `documented`: what the log's format says: True of an estimator that the gyros drive.

    >>> level = Record([[0.0] * 6] * 5, channels=["p", "q", "r", "phi", "theta", "psi"], sample_period_s=0.01)
    >>> origin_of([level]).is_driven, origin_of([level], documented=False).is_driven
    (True, False)
    """
    if documented is not None:
        kind = "an estimator's, which the gyros drive" if documented else "of its own"
        return Origin(is_driven=documented, why=f"the log's format documents that it is {kind}")
    spectra = spectra_of(records)
    if not spectra:
        return _assumed("its rate can't be compared with the gyros")
    missing = {gyro: found for gyro, each in spectra.items() if (found := _missing(each)) is not None}
    standing = {gyro: share for gyro, each in spectra.items() if (share := _standing(each)) is not None}
    if len(missing) >= _FEWEST and not standing.keys() - missing.keys():
        return Origin(
            is_driven=False,
            why=_own(missing),
            shares={gyro: found.share for gyro, found in missing.items()},
        )
    shares = {gyro: share for gyro, share in standing.items() if gyro not in missing}
    if shares:
        said = listed([f"{100.0 * share:.0f} % of {gyro}" for gyro, share in shares.items()])
        return _assumed(f"its rate lacks only {said} at high frequencies", shares)
    return _assumed("the gyros' noise can't be told from motion and from the attitude's own noise")


def _assumed(why: str, shares: Mapping[str, float] | None = None) -> Origin:
    """Return that an attitude is taken for driven, and why it can't be said to be of its own."""
    return Origin(is_driven=True, why=f"as most are; {why}", shares=shares or {}, is_assumed=True)


def _own(missing: Mapping[str, _Missing]) -> str:
    said = [f"{100.0 * found.share:.0f} % of {gyro}'s noise" for gyro, found in missing.items()]
    low, high = min(each.low_hz for each in missing.values()), max(each.high_hz for each in missing.values())
    return f"its rate lacks {listed(said)} at {low:.2g} to {high:.2g} Hz"


def _bands(spectra: RateSpectra) -> list[tuple[float, float]]:
    """Return half octaves from low to high."""
    lowest = max(_LOWEST_HZ, 2.5 * float(spectra.frequency_hz[1]))
    edges = [spectra.highest_hz]
    while edges[-1] / _HALF_OCTAVE >= lowest:
        edges.append(edges[-1] / _HALF_OCTAVE)
    return list(pairwise(reversed(edges)))


def _missing(spectra: RateSpectra) -> _Missing | None:
    """Find the highest octave in which a gyro's noise is missing in the attitude's rate."""
    bands = _bands(spectra)
    rate_hz = 2.0 * float(spectra.frequency_hz[-1])
    if rate_hz < _SLOWEST_HZ:
        return None
    grid = _OF_GRID * spectra.quantum**2 / 12.0 * 2.0 / rate_hz
    for place in range(len(bands) - 2, 0, -1):
        low, high = bands[place][0], bands[place + 1][1]
        quiet, loud = spectra.halves
        for windows in (quiet, quiet | loud):
            gain = spectra.gain(low, high, windows)
            if gain is None or gain.value + _ERRORS * gain.deviation > _MOST or gain.density < grid:
                continue
            flat = bands[place : place + 2] if rate_hz > _NOTHING_FOLDS_HZ else bands[place:]
            if not _is_flat([spectra.gain(*band, windows) for band in flat]):
                continue
            if _follows_the_rest(spectra, bands[:place], bands[place + 2 :], gain.density):
                return _Missing(share=1.0 - gain.value, low_hz=low, high_hz=high)
    return None


def _follows_the_rest(
    spectra: RateSpectra,
    below: Sequence[tuple[float, float]],
    above: Sequence[tuple[float, float]],
    noise: float,
) -> bool:
    """Tell whether, of a gyro's noise, the rate follows the rest, band by band, and down to where nearly all is that.

    Of the noise it follows less than a tenth there, too, all bands taken together. And what it follows is all equally
    late: a low-pass turns each frequency by another time.
    """
    excess, weight = 0.0, 0.0
    for place, band in reversed(list(enumerate(below))):
        told = [_beside(spectra, band, windows, noise) for windows in spectra.halves]
        if any(each is None or not each.agrees for each in told):
            return False
        for each in told:
            if each is not None:
                excess += each.weight * each.excess
                weight += each.weight
        if any(each is not None and each.motion >= _FOLLOWS for each in told):
            others = [_beside(spectra, other, windows, noise) for other in above for windows in spectra.halves]
            is_missing = excess / weight + weight**-0.5 <= _MOST
            agree = all(each is None or each.agrees for each in others)
            return is_missing and agree and _is_equally_late(spectra, below[place:])
    return False


def _is_equally_late(spectra: RateSpectra, bands: Sequence[tuple[float, float]]) -> bool:
    """Tell whether no band follows a gyro better at a delay of its own than at that of the first, which is motion."""
    quiet, loud = spectra.halves
    late_s = spectra.late_s(*bands[0], quiet | loud, 1.0 / (_TURN * bands[-1][1]))
    for band in bands:
        gain = spectra.gain(*band, quiet | loud)
        if gain is not None and gain.value - spectra.gain_at(*band, quiet | loud, late_s) > (
            _APART * gain.value + _LATE_ERRORS * gain.deviation
        ):
            return False
    return True


def _is_flat(gains: Sequence[Gain | None]) -> bool:
    """Tell whether a gyro has the same power in all bands, as noise has, and neither motion nor what folds back."""
    seen = [gain for gain in gains if gain is not None]
    lowest = min(seen, key=lambda gain: gain.density)
    return all(gain.density < (_FLAT + 2.0 * (gain.of_density + lowest.of_density)) * lowest.density for gain in seen)


@dataclass(frozen=True, kw_only=True)
class _Beside:
    """A band's gain beside the one that is expected of a rate that follows all but the gyro's noise."""

    motion: float  # the expected gain
    excess: float  # which share of the noise there is more
    weight: float  # of that share
    agrees: bool


def _beside(spectra: RateSpectra, band: tuple[float, float], windows: BoolArray, noise: float) -> _Beside | None:
    """Hold a band's gain beside what is expected; None where it can't be seen."""
    gain = spectra.gain(*band, windows)
    if gain is None or gain.deviation > _UNSEEN:
        return None
    share = min(noise / gain.density, 1.0)  # that is noise
    excess = gain.value - (1.0 - share)
    error = math.hypot(gain.deviation, share * gain.of_density)
    return _Beside(
        motion=1.0 - share,
        excess=excess / share,
        weight=share**2 / error**2,
        agrees=abs(excess) <= _APART + _OF_MOTION * (1.0 - share) + _ERRORS * error,
    )


def _standing(spectra: RateSpectra) -> float | None:
    """Return how much of a gyro is missing in the attitude's rate, in the highest octave where most of it isn't."""
    bands = _bands(spectra)
    for place in range(len(bands) - 2, -1, -1):
        low, high = bands[place][0], bands[place + 1][1]
        quiet, _ = spectra.halves
        gain: Gain | None = spectra.gain(low, high, quiet)
        if gain is not None and gain.deviation < _SURE:
            return max(1.0 - gain.value, 0.0) if gain.value > _STANDS else None
    return None


_MEAN_S = 0.5  # samples are means over this long: the attitude's own noise and small delays are not
_BLOCK_S = 20.0  # a block has a constant and a trend of its own, as of a bias that wanders
_FEWEST_BLOCKS = 3  # blocks, whose scatter is the error
_LARGEST_ERROR = 0.3  # relative; of two axes that differ half of it is error


@dataclass(frozen=True, kw_only=True)
class TimeConstant:
    """How long an estimator trusts its gyros."""

    # time_constant_s, deviation_s: it, and its standard error
    time_constant_s: float
    deviation_s: float


def time_constant_of(records: Sequence[Record]) -> TimeConstant | None:
    """Return the time constant of an estimator whose references accelerometers tell; None where nothing shows it.

    Roll and pitch both have to show it, each to 30 %, and differ by no more than that to either side: a factor of 1.8.

    `records`: healthy; p, q, r in deg/s, phi, theta, psi in deg, nx, ny, nz in g. Those that lack a channel are passed
    over, and so are blocks of 20 s in which a sample is missing.

    >>> import gtmbench as gb
    >>> truth = gb.fly(excitation="doublets", duration_s=90.0)
    >>> readings = gb.measure(truth, noise="t2")
    >>> for angle, told in zip(("phi", "theta"), accelerometers_tilt(readings)):
    ...     readings = readings.replace(angle, told)  # what the estimator is corrected by
    >>> estimated = gb.filtered_attitude(readings, time_constant_s=5.0)
    >>> round(time_constant_of([estimated]).time_constant_s, 1), time_constant_of([readings]) is None
    (5.0, True)
    """
    wanted = {*GYROS, *ATTITUDE, *ACCELEROMETERS}
    usable = [record for record in records if wanted <= set(record.channels)]
    pairs = [list(axis) for axis in zip(*(block for record in usable for block in _blocks(record)), strict=True)]
    found = [_regressed(np.array(axis)) for axis in pairs if len(axis) >= _FEWEST_BLOCKS]
    if not found or any(each is None for each in found):
        return None
    (roll, roll_error), (pitch, pitch_error) = (each for each in found if each is not None)
    apart = abs(math.log(roll / pitch))
    error = math.hypot(max(roll_error, pitch_error), 0.5 * apart)
    if error > _LARGEST_ERROR:
        return None
    time_constant_s = math.sqrt(roll * pitch)
    return TimeConstant(time_constant_s=time_constant_s, deviation_s=error * time_constant_s)


def accelerometers_tilt(record: Record) -> tuple[FloatArray, FloatArray]:
    """Return phi and theta in deg, as accelerometers tell them of an aircraft that doesn't accelerate.

    nx points forward, ny to the right, nz up, in g: level and at rest they read 0, 0 and 1.

    >>> tilted = Record([[0.5, 0.0, 0.75**0.5]], channels=["nx", "ny", "nz"], sample_period_s=1.0)
    >>> [round(float(angle[0]), 6) for angle in accelerometers_tilt(tilted)]
    [-0.0, 30.0]
    """
    nx, ny, nz = (record[name] for name in ACCELEROMETERS)
    return np.degrees(np.arctan2(-ny, nz)), np.degrees(np.arctan2(nx, np.hypot(ny, nz)))


def _blocks(record: Record) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield, block by block, roll's and pitch's e, z - x and integral of e: of shape (3, means)."""
    axes = [
        _series(record, angle, rate, told)
        for angle, rate, told in zip(("phi", "theta"), _kinematics(record), accelerometers_tilt(record), strict=True)
    ]
    rows = max(round(_MEAN_S / record.sample_period_s), 1)
    means = max(round(_BLOCK_S / (rows * record.sample_period_s)), 1)
    for start in range(0, len(record) - rows * means, rows * means):
        block = [axis[:, start : start + rows * means].reshape(3, means, rows).mean(axis=2) for axis in axes]
        if means > 4 and all(np.isfinite(each).all() for each in block):
            roll, pitch = (_without_trend(each) for each in block)
            yield roll, pitch


def _kinematics(record: Record) -> tuple[FloatArray, FloatArray]:
    """Return phi' and theta' in deg/s as the gyros tell them."""
    phi, theta = np.radians(record["phi"]), np.radians(record["theta"])
    q, r = record["q"], record["r"]
    rolling = record["p"] + np.tan(theta) * (q * np.sin(phi) + r * np.cos(phi))
    return rolling, q * np.cos(phi) - r * np.sin(phi)


def _series(record: Record, angle: str, rate: FloatArray, told: FloatArray) -> FloatArray:
    """Return e, z - x and the integral of e of an angle, between the rows of a record."""
    period_s, x = record.sample_period_s, record[angle]
    pull = _turn(np.diff(x)) / period_s - 0.5 * (rate[1:] + rate[:-1])
    off = _turn(told - x)
    there = np.where(np.isfinite(pull), pull, 0.0)
    pulled = period_s * (np.cumsum(there) - 0.5 * there)
    return np.array([pull, 0.5 * (off[1:] + off[:-1]), pulled])


def _turn(angles: FloatArray) -> FloatArray:
    return np.mod(angles + 180.0, 360.0) - 180.0


def _without_trend(block: FloatArray) -> FloatArray:
    basis, _ = np.linalg.qr(np.vander(np.arange(block.shape[1], dtype=float), 2))
    return np.asarray(block - (block @ basis) @ basis.T)


def _regressed(blocks: FloatArray) -> tuple[float, float] | None:
    """Return an axis's time constant and its relative error; None where the slopes show none.

    Where z - x is in error, too, the slope of e on it is too flat and that of z - x on e too steep by what isn't
    coherent. Their geometric mean is told, and how far they are from it is part of the error; so are the scatter over
    the blocks (a jackknife) and the slope on the integral.
    """
    products = np.einsum("bim,bjm->bij", blocks, blocks)
    total = products.sum(axis=0)
    coherence = _coherence(total)
    if not coherence > 0.0:
        return None
    slope, steady = _slopes(total)
    if not slope > 0.0:
        return None
    others = np.array([_slopes(total - each)[0] for each in products])
    scatter = math.sqrt((len(others) - 1) * float(np.var(others))) / slope
    error = math.hypot(scatter, steady / slope, 1.0 / coherence - 1.0)
    return math.sqrt(total[1, 1] / total[0, 0]), error


def _coherence(products: FloatArray) -> float:
    """Return the correlation of e with z - x, zero where either stands still."""
    power = math.sqrt(products[0, 0] * products[1, 1])
    return float(products[0, 1]) / power if power > 0.0 else 0.0


def _slopes(products: FloatArray) -> tuple[float, float]:
    """Return the slopes of e on z - x and on its own integral."""
    slope, steady = np.linalg.lstsq(products[1:, 1:], products[1:, 0], rcond=None)[0].tolist()
    return slope, steady
