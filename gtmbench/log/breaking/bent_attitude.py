"""Whether a log's attitude follows a gyro's fault, by which estimator, and what becomes of its samples."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gtmbench.checks import meant
from gtmbench.errors import InputError
from gtmbench.intake.contents import ChannelSamples, log_contents
from gtmbench.intake.open import open_log
from gtmbench.intake.read import ReadLog, read_log
from gtmbench.log.opening.driven_attitude import FROM_LOG, origin_in_logs
from gtmbench.method.driven_attitude import TimeConstant, time_constant_of
from gtmbench.values.attitude_estimators import OWN, USUAL_S, AttitudeEstimator, held
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, GYROS
from gtmbench.values.clock import FloatArray

FOLLOWS = "follows"
_KINDS = (FROM_LOG, OWN, FOLLOWS)
_GAP = 3.5  # periods without a sample are a gap, over which an estimator goes on
_MOST = 1000  # steps over a gap


@dataclass(frozen=True, kw_only=True)
class AttitudeFollowing:
    """Whether an attitude follows the faults of gyros.

    Attributes
    ----------
    estimator : AttitudeEstimator or None
        What computes it from the gyros; None where it doesn't follow.
    why : str
        Why it follows, or doesn't.
    time_constant : str
        Where the estimator's time constant is from.
    """

    estimator: AttitudeEstimator | None
    why: str
    time_constant: str = ""

    @property
    def text(self) -> str:
        """Two sentences that tell it.

        >>> AttitudeFollowing(estimator=None, why="it was asked for").text
        'The attitude stays as it is (it was asked for).'
        """
        does = "stays as it is"
        if self.estimator is not None:
            known = f"{self.estimator.time_constant_s:.3g} s ({self.time_constant})"
            does = f"follows the fault: an estimator with a time constant of {known} computes it from the gyros"
        return f"The attitude {does} ({self.why})."


def following_in_log(
    log: Path | ReadLog,
    broken: Iterable[str],
    mapping: Sequence[str] = (),
    *,
    attitude: str | AttitudeEstimator = FROM_LOG,
    time_constant_s: float | None = None,
) -> AttitudeFollowing:
    """Return whether a log's attitude follows faults of some channels.

    `attitude`: "follows", or "follows:2.5" with a time constant of 2.5 s, or an estimator; "own": it stays as it is;
    "auto": it follows where the gyros drive it (`origin_in_logs`). `time_constant_s`: of the estimator; without it the
    log's own, where that shows (`time_constant_in_log`), else 5 s.
    """
    kind, told = _named_estimator(attitude, time_constant_s)
    if kind == OWN:
        return AttitudeFollowing(estimator=None, why=_TOLD)
    read = read_log(log)
    why_not = _why_not(read, broken, mapping)
    if why_not and kind == FOLLOWS:
        raise InputError(f"{read.path}: no attitude can follow, for {why_not}; leave 'follows' out")
    if why_not:
        return AttitudeFollowing(estimator=None, why=why_not)
    why = _TOLD
    if kind == FROM_LOG:
        origin = origin_in_logs([read], mapping, spans=[(-math.inf, math.inf)])
        if not origin.is_driven:
            return AttitudeFollowing(estimator=None, why=f"the gyros don't drive it: {origin.why}")
        why = f"assumed, {origin.why}" if origin.is_assumed else origin.why
    if told is not None:
        return AttitudeFollowing(estimator=told, why=why, time_constant="as given")
    found = time_constant_in_log(read, mapping)
    if found is None:
        return AttitudeFollowing(estimator=AttitudeEstimator(time_constant_s=USUAL_S), why=why, time_constant="assumed")
    estimator = AttitudeEstimator(time_constant_s=found.time_constant_s)
    return AttitudeFollowing(estimator=estimator, why=why, time_constant=f"the log's own, +-{found.deviation_s:.2g} s")


_TOLD = "it was asked for"


def _named_estimator(
    attitude: str | AttitudeEstimator, time_constant_s: float | None
) -> tuple[str, AttitudeEstimator | None]:
    """Return whether an attitude is to follow, and by which estimator, where that is told."""
    if isinstance(attitude, AttitudeEstimator):
        return FOLLOWS, attitude
    kind, _, seconds = attitude.partition(":")
    if kind not in _KINDS or (seconds and kind != FOLLOWS):
        names = (*_KINDS, f"{FOLLOWS}:SECONDS")
        raise InputError(f"no attitude '{attitude}'; there is {', '.join(names)}{meant(kind, _KINDS)}")
    if seconds and time_constant_s is None:
        try:
            time_constant_s = float(seconds)
        except ValueError:
            raise InputError(f"attitude '{attitude}': '{seconds}' is no time constant in seconds") from None
    if time_constant_s is None:
        return kind, None
    if kind == OWN:
        raise InputError("an attitude that is its own has no time constant; leave it out, or say 'follows'")
    return kind, AttitudeEstimator(time_constant_s=time_constant_s)


def _why_not(log: Path | ReadLog, broken: Iterable[str], mapping: Sequence[str]) -> str:
    """Return why no attitude can follow; empty where it can."""
    if not set(broken) & set(GYROS):
        return "no gyro breaks"
    there = log_contents(log, mapping=mapping).usable
    missing = [name for name in ("phi", "theta") if name not in there]
    return f"the log has no {' and no '.join(missing)}" if missing else ""


def time_constant_in_log(log: Path | ReadLog, mapping: Sequence[str] = ()) -> TimeConstant | None:
    """Return the time constant of the estimator that makes a log's attitude; None where nothing shows it."""
    wanted, read = (*GYROS, *ATTITUDE, *ACCELEROMETERS), read_log(log)
    if not {*wanted} <= {*log_contents(read, mapping=mapping).usable}:
        return None
    try:
        return time_constant_of(open_log(read, mapping=mapping, needs=wanted).segments)
    except InputError:  # samples that make no record can be broken all the same
        return None


def bent_samples(
    estimator: AttitudeEstimator,
    samples: Mapping[str, ChannelSamples],
    broken: Mapping[str, FloatArray],
) -> dict[str, FloatArray]:
    """Return the attitude's samples as an estimator makes them of broken gyros: theirs, and how far it bends.

    Gyros and attitude are laid on the stamps of all gyros, where the bend is worked out by
    `AttitudeEstimator.bent_path`, and the bend onto the stamps of each angle.

    `samples`: of the gyros and angles that the log has; one that it hasn't counts as zero. `broken`: values of the
    gyros' samples with faults.
    """
    time_s = _stamps([samples[name] for name in GYROS if name in samples])

    def laid(names: Sequence[str], values: Mapping[str, FloatArray]) -> FloatArray:
        none = np.zeros(len(time_s))
        return np.column_stack(
            [np.interp(time_s, samples[name].time_s, values[name]) if name in samples else none for name in names]
        )

    healthy = {name: each.values for name, each in samples.items()}
    told = {name: held(values[:, np.newaxis])[:, 0] for name, values in broken.items()}
    unwrapped = {name: np.unwrap(healthy[name], period=360.0) for name in ATTITUDE if name in samples}
    attitude = laid(ATTITUDE, unwrapped)
    bent = estimator.bent_path(np.diff(time_s), laid(GYROS, healthy), laid(GYROS, told), attitude, time_s)
    new = {
        name: healthy[name] + np.interp(samples[name].time_s, time_s, (bent - attitude)[:, i])
        for i, name in enumerate(ATTITUDE)
        if name in samples
    }
    return new | {"phi": _within_a_turn(new["phi"])}


def _stamps(gyros: Sequence[ChannelSamples]) -> FloatArray:
    """Return the stamps of all gyros, and more in their gaps."""
    time_s = np.unique(np.concatenate([each.time_s for each in gyros]))
    period_s = min(each.sample_period_s for each in gyros)
    gaps = np.flatnonzero(np.diff(time_s) > _GAP * period_s)
    counts = [min(math.ceil((time_s[k + 1] - time_s[k]) / period_s), _MOST) for k in gaps]
    filled = [np.linspace(time_s[k], time_s[k + 1], count + 1) for k, count in zip(gaps, counts, strict=True)]
    return np.unique(np.concatenate([time_s, *filled]))


def _within_a_turn(angles: FloatArray) -> FloatArray:
    """Return angles within +-180 deg, those that are so already as they are."""
    return np.where(np.abs(angles) > 180.0, np.mod(angles + 180.0, 360.0) - 180.0, angles)
