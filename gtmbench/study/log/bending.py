"""Whether a log's attitude follows a gyro's fault, by which estimator, and what becomes of its samples."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gtmbench.attitude import ATTITUDE, GYROS, OWN, USUAL_S, AttitudeEstimator
from gtmbench.checks import meant
from gtmbench.clock import FloatArray
from gtmbench.errors import InputError
from gtmbench.intake.contents import log_contents
from gtmbench.intake.open import open_log
from gtmbench.intake.samples import Samples
from gtmbench.method.time_constant import ACCELEROMETERS, TimeConstant, time_constant_of
from gtmbench.study.log.origin import FROM_LOG, origin_in_logs

FOLLOWS = "follows"
ATTITUDES = (FROM_LOG, OWN, FOLLOWS)


@dataclass(frozen=True, kw_only=True)
class Following:
    """Whether an attitude follows the faults of gyros.

    Attributes
    ----------
    estimator : AttitudeEstimator or None
        What makes it of the gyros; None where it doesn't follow.
    why : str
        What that stands on.
    """

    estimator: AttitudeEstimator | None
    why: str

    @property
    def text(self) -> str:
        """A sentence of it.

        >>> Following(estimator=None, why="as it was told").text
        'The attitude stays as it is (as it was told).'
        """
        if self.estimator is None:
            return f"The attitude stays as it is ({self.why})."
        tau = self.estimator.time_constant_s
        return f"The attitude follows, as an estimator with a time constant of {tau:.3g} s makes it ({self.why})."


def following_in_log(
    log: Path,
    broken: Iterable[str],
    mapping: Sequence[str] = (),
    *,
    attitude: str = FROM_LOG,
    time_constant_s: float | None = None,
) -> Following:
    """Return whether a log's attitude follows faults of some channels.

    Parameters
    ----------
    log : Path
        Healthy.
    broken : iterable of str
        The channels that faults change.
    mapping : sequence of str
        As `open_log` takes it.
    attitude : str
        "follows", "own" (it stays as it is), or "auto": it follows where the gyros drive it (`origin_in_logs`).
    time_constant_s : float, optional
        Of the estimator; without it the log's own, where that shows (`time_constant_in_log`), else 5 s.

    Raises
    ------
    InputError
        Where the log can't be read, or is to follow and holds no attitude.
    """
    if attitude not in ATTITUDES:
        raise InputError(f"no attitude '{attitude}'; there is {', '.join(ATTITUDES)}{meant(attitude, ATTITUDES)}")
    if attitude == OWN:
        return Following(estimator=None, why="as it was told")
    there = log_contents(log, mapping=mapping).usable
    missing = [name for name in ("phi", "theta") if name not in there]
    if not set(broken) & set(GYROS) or missing:
        why = f"the log has no {' and no '.join(missing)}" if missing else "no gyro breaks"
        if attitude == FOLLOWS:
            raise InputError(f"{log}: no attitude can follow: {why}; leave --attitude out, or say 'own'")
        return Following(estimator=None, why=why)
    why = "as it was told"
    if attitude == FROM_LOG:
        origin = origin_in_logs([log], mapping, spans=[(-math.inf, math.inf)])
        why = origin.why
        if not origin.is_driven:
            return Following(estimator=None, why=why)
    if time_constant_s is not None:
        return Following(estimator=AttitudeEstimator(time_constant_s=time_constant_s), why=why)
    found = time_constant_in_log(log, mapping)
    if found is None:
        return Following(
            estimator=AttitudeEstimator(time_constant_s=USUAL_S), why=f"{why}; its time constant is assumed"
        )
    return Following(
        estimator=AttitudeEstimator(time_constant_s=found.time_constant_s),
        why=f"{why}; its time constant is the log's, +-{found.deviation_s:.2g} s",
    )


def time_constant_in_log(log: Path, mapping: Sequence[str] = ()) -> TimeConstant | None:
    """Return the time constant of the estimator that makes a log's attitude; None where nothing shows it."""
    wanted = (*GYROS, *ATTITUDE, *ACCELEROMETERS)
    if not {*wanted} <= {*log_contents(log, mapping=mapping).usable}:
        return None
    return time_constant_of(open_log(log, mapping=mapping, needs=wanted).segments)


def bent_samples(
    estimator: AttitudeEstimator,
    samples: Mapping[str, Samples],
    broken: Mapping[str, FloatArray],
) -> dict[str, FloatArray]:
    """Return the attitude's samples as an estimator makes them of broken gyros: theirs, and how far it bends.

    Gyros and attitude are laid on the stamps of all gyros, where the bend is worked out by
    `AttitudeEstimator.bent_path`, and the bend onto the stamps of each angle.

    Parameters
    ----------
    samples : mapping
        Of the gyros and angles that the log has; one that it hasn't counts as zero.
    broken : mapping
        Values of the gyros' samples with faults.
    """
    gyros = [name for name in GYROS if name in samples]
    time_s = np.unique(np.concatenate([samples[name].time_s for name in gyros]))

    def laid(names: Sequence[str], values: Mapping[str, FloatArray]) -> FloatArray:
        none = np.zeros(len(time_s))
        return np.column_stack(
            [np.interp(time_s, samples[name].time_s, values[name]) if name in samples else none for name in names]
        )

    healthy = {name: each.values for name, each in samples.items()}
    attitude = laid(ATTITUDE, healthy)
    bent = estimator.bent_path(
        np.diff(time_s), laid(GYROS, healthy), laid(GYROS, {**healthy, **broken}), attitude, time_s
    )
    return {
        name: healthy[name] + np.interp(samples[name].time_s, time_s, (bent - attitude)[:, i])
        for i, name in enumerate(ATTITUDE)
        if name in samples
    }
