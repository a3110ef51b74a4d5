"""Whether the gyros drive the attitude, as an estimator's, or whether it is of its own: found out from the samples.

An attitude that integrates the gyros holds their noise; one of a vertical gyro, of motion capture or of a simulation
doesn't. So a gyro's noise is looked for in the attitude's rate, at frequencies at which the motion is small.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from gtmbench.checks import listed
from gtmbench.method.rate_spectra import Gain, RateSpectra, spectra_of
from gtmbench.values.channels import GYROS
from gtmbench.values.record import BoolArray, Record

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
