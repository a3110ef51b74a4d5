"""What a watched log shows of each gyro, in figures that can be laid beside those of other flights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtmbench.detectors.protocol import Watch
from gtmbench.log.self_check.motion import attitude_rates
from gtmbench.log.watched_log import WatchedLog
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import FloatArray, Record

_BLOCK_S = 10.0  # of noise, of which the median counts
_WHOLE = 0.5  # of a block's rows, or it doesn't count
_FEWEST = 3  # blocks
_ORDER = 4  # of the difference: an aircraft moves slowly beside its sensors' samples
_SPREAD = np.sqrt(70.0)  # of that difference of white noise of deviation 1: 1, 4, 6, 4, 1


@dataclass(frozen=True, kw_only=True)
class GyroFigures:
    """A gyro on a flight, in deg/s; None where the log doesn't tell."""

    name: str  # p, q or r
    residual_rms: float | None  # of the monitor's residual, where an alarm was possible
    bias: float | None  # by how much it reads more than the attitude turns: the median over blocks of 10 s
    # What it reads from sample to sample beyond slow motion, vibration included: fourth differences, as a deviation,
    # the median over blocks of 10 s. Of logs of one rate only it can be compared.
    noise: float | None


def gyro_figures(watched: WatchedLog) -> tuple[GyroFigures, ...]:
    """Return the figures of p, q and r.

    Of what was watched, and of what was identified on as well: a turn-on bias is as much there.
    """
    passed = watched.check.passed and bool(watched.watches)
    segments = watched.log.segments
    return tuple(
        GyroFigures(
            name=name,
            residual_rms=_residual_rms(watched.watches, name),
            bias=_median([_biases(record, place) for record in segments]) if passed else None,
            noise=_median([_noises(record, name) for record in segments]),
        )
        for place, name in enumerate(GYROS)
    )


def _residual_rms(watches: Sequence[Watch], name: str) -> float | None:
    told = [watch for watch in watches if name in watch.residuals and name in watch.scores]
    values = np.concatenate([watch.residuals[name][watch.scores[name].armed] for watch in told] or [np.empty(0)])
    values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else None


def _biases(record: Record, place: int) -> FloatArray:
    """Return by how much a gyro reads more than the attitude turns, block by block."""
    if not {*GYROS, *ATTITUDE} <= set(record.channels):
        return np.empty(0)
    turned = attitude_rates(record)
    blocks = _blocks(record.matrix(GYROS)[:, place] - turned[:, place], record.sample_period_s)
    return np.array([np.nanmean(block) for block in blocks])


def _noises(record: Record, name: str) -> FloatArray:
    if name not in record.channels or len(record) <= _ORDER:
        return np.empty(0)
    blocks = _blocks(np.diff(record[name], _ORDER), record.sample_period_s)
    return np.array([np.sqrt(np.nanmean(np.square(block))) / _SPREAD for block in blocks])


def _blocks(values: FloatArray, period_s: float) -> list[FloatArray]:
    """Return the blocks of 10 s that hold enough samples."""
    rows = max(round(_BLOCK_S / period_s), 1)
    parts = [values[first : first + rows] for first in range(0, len(values) - rows + 1, rows)]
    return [part for part in parts if np.count_nonzero(np.isfinite(part)) >= _WHOLE * rows]


def _median(parts: Sequence[FloatArray]) -> float | None:
    values = np.concatenate(parts)
    return float(np.median(values)) if len(values) >= _FEWEST else None
