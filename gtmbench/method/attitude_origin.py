"""Whether the gyros drive the attitude, as an estimator's, or whether it is of its own: found out from the samples.

An attitude that integrates the gyros holds their noise; one of a vertical gyro, of motion capture or of a simulation
doesn't. So a gyro's noise is looked for in the attitude's rate, at frequencies at which the motion is small.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from gtmbench.checks import listed
from gtmbench.method.rate_spectra import Gain, RateSpectra, spectra_of
from gtmbench.record import Record

_HALF_OCTAVE = 2.0**0.5
_LOWEST_HZ = 0.5
_FEWEST = 2  # gyros whose noise has to be missing in the attitude
_WIDEST_HZ = 1000.0  # a gyro's noise, both sides of zero: unfiltered, a slower log holds so much more than its attitude
_MOST = 0.1  # of its noise may stand in an own attitude
_ERRORS = 2.0  # standard errors, by which that is kept
_FOLLOWS = 0.85  # of what a gyro reads is motion, so that it shows that the attitude's rate passes it
_APART, _UNSEEN = 0.15, 0.1  # by which a gain may differ from the expected one; a standard error that tells nothing
_STANDS, _SURE = 0.5, 0.15  # a share of the gyro in the attitude, and its standard error, that show that it drives it
_OF_GRID = 4.0  # times the power of its readings' steps is noise


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Where an attitude comes from.

    Attributes
    ----------
    is_driven : bool
        Whether the gyros drive it, so that a gyro's fault bends it.
    why : str
        What was measured, what the format documents, or that driven is assumed, for nothing shows it.
    shares : mapping of float
        By gyro, where it was measured: how much of its noise stands in the gyro less the attitude's rate.
    """

    is_driven: bool
    why: str
    shares: Mapping[str, float] = field(default_factory=dict)


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

    Missing means, in an octave: the rate's regression on the gyro leaves less than a tenth, or than a gyro's noise that
    was sampled without a filter would leave (the sample rate over 1 kHz), whatever the delay up to a quarter of a
    second. And below that octave the rate has to follow the gyro by as much as it stands above that noise, in quiet and
    in loud windows, up to where nearly all is motion: an attitude that was low-passed follows it by another curve.

    Parameters
    ----------
    records : sequence of Record
        p, q, r in deg/s, phi, theta, psi in deg; at one rate, the gyros as fast as they can be had. Of others nothing
        can be told.
    documented : bool, optional
        What the log's format says: True of an estimator that the gyros drive.

    Examples
    --------
    >>> level = Record([[0.0] * 6] * 5, channels=["p", "q", "r", "phi", "theta", "psi"], sample_period_s=0.01)
    >>> origin_of([level]).is_driven, origin_of([level], documented=False).is_driven
    (True, False)
    """
    if documented is not None:
        kind = "that the gyros drive" if documented else "of its own"
        return Origin(is_driven=documented, why=f"the log's format documents an attitude {kind}")
    spectra = spectra_of(records)
    if not spectra:
        return Origin(is_driven=True, why="gyros and attitude can't be compared, and most attitudes are driven by them")
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
        return Origin(is_driven=True, why=f"only {said} stands in gyro less attitude's rate", shares=shares)
    return Origin(
        is_driven=True,
        why="the gyros' noise can't be told from motion and the attitude's own noise, and most attitudes are driven",
    )


def _own(missing: Mapping[str, _Missing]) -> str:
    said = [f"{100.0 * found.share:.0f} % of {gyro}'s noise" for gyro, found in missing.items()]
    low, high = min(each.low_hz for each in missing.values()), max(each.high_hz for each in missing.values())
    return f"{listed(said)} at {low:.2g} to {high:.2g} Hz stand in gyro less attitude's rate"


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
    most = min(_MOST, rate_hz / _WIDEST_HZ)
    grid = _OF_GRID * spectra.quantum**2 / 12.0 * 2.0 / rate_hz
    for place in range(len(bands) - 2, 0, -1):
        low, high = bands[place][0], bands[place + 1][1]
        quiet, loud = spectra.halves
        for windows in (quiet, quiet | loud):
            gain = spectra.gain(low, high, windows)
            if gain is None or gain.value + _ERRORS * gain.deviation > most or gain.density < grid:
                continue
            below = [_as_expected(spectra, band, gain.density) for band in reversed(bands[:place])]
            above = [_as_expected(spectra, band, gain.density) for band in bands[place + 2 :]]
            passed = next((k for k, each in enumerate(below) if each != "agrees"), None)
            if passed is not None and below[passed] == "follows" and "differs" not in above:
                return _Missing(share=1.0 - gain.value, low_hz=low, high_hz=high)
    return None


def _as_expected(spectra: RateSpectra, band: tuple[float, float], noise: float) -> str:
    """Say whether the rate follows what the gyro reads above its noise, as it does where that noise isn't in it."""
    told = []
    for windows in spectra.halves:
        gain = spectra.gain(*band, windows)
        if gain is None or gain.deviation > _UNSEEN:
            return "unseen"
        motion = max(1.0 - noise / gain.density, 0.0)
        if abs(gain.value - motion) > _APART + 1.5 * _ERRORS * gain.deviation:
            return "differs"
        told.append(motion)
    return "follows" if max(told) >= _FOLLOWS else "agrees"


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
