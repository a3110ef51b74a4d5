"""A page of numpy enters gtmbench-2: a windowed likelihood ratio on whitened kinematic increments, by axis.

    gtmbench benchmark --quick --detector experiments/benchmark_glr.py:WindowedGlr

What each angle turned from sample to sample, along the body's axes, less what a short FIR filter makes of the gyro, is
whitened by an autoregression; both are learnt on `learn`. Each sample is put over the deviation of the last 10 s and
clipped, and of every window of 1, 2, 4, ... samples the log-likelihood ratios of a shift and of a louder noise are
taken (Willsky and Jones 1976, IEEE Transactions on Automatic Control 21). The largest is the score.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.signal import lfilter

import gtmbench as gb

GYROS, ANGLES = ("p", "q", "r"), ("phi", "theta", "psi")
FIR_S, ORDER, LEVEL_S, LATE_S, LONGEST_S = 0.12, 12, 10.0, 0.5, 20.0
CLIP, LOUD = 5.0, 0.5  # deviations; what a nat of louder noise counts beside one of a shift
FILLED = 3  # samples that may be missing at a time


@dataclass(frozen=True)
class WindowedGlr(gb.ScoreDetector):
    """The detector; what it reads and what it tells apart."""

    name: str = "windowed-glr"
    channels: tuple[str, ...] = (*GYROS, *ANGLES)
    clip: float = CLIP
    loud: float = LOUD
    level_s: float = LEVEL_S
    longest_s: float = LONGEST_S
    tuned: str = "nothing: settings as first written"

    def learn(self, records: Sequence[gb.Record]) -> dict[str, object]:
        """Return taps of the FIR filters with a constant, autoregressions and deviations, an axis each."""
        lags = max(round(FIR_S / records[0].sample_period_s), 2)
        taps, poles, deviations = [], [], []
        for axis in range(3):
            parts = [equations(record, axis, lags) for record in records]
            ahead = np.zeros(ORDER)
            for _ in range(3):  # the noise's colour weights the equations, the equations give the noise
                whitened = [lfilter([1.0, *-ahead], [1.0], part, axis=0)[good] for part, good in parts]
                left, right = (
                    np.vstack([each[:, :-1] for each in whitened]),
                    np.hstack([each[:, -1] for each in whitened]),
                )
                found = np.linalg.lstsq(left, right, rcond=None)[0]
                off = [(part[:, -1] - part[:, :-1] @ found, good) for part, good in parts]
                ahead = autoregression(off)
            taps.append(found.tolist())
            poles.append(ahead.tolist())
            deviations.append(float(np.std(np.hstack([lfilter([1.0, *-ahead], [1.0], e)[good] for e, good in off]))))
        return {"taps": taps, "poles": poles, "deviations": deviations}

    def scores(self, record: gb.Record, learned: Mapping[str, object]) -> dict[str, np.ndarray]:
        """Return the largest log-likelihood ratio of each axis, in nats."""
        found = {}
        for axis, name in enumerate(GYROS):
            taps, ahead = np.array(learned["taps"][axis]), np.array(learned["poles"][axis])
            part, good = equations(record, axis, len(taps) - 2)
            white = lfilter([1.0, *-ahead], [1.0], part[:, -1] - part[:, :-1] @ taps)
            white = np.where(good, white, 0.0) / learned["deviations"][axis]
            found[name] = self.ratios(white, good, record.sample_period_s)
        return found

    def ratios(self, white: np.ndarray, good: np.ndarray, period_s: float) -> np.ndarray:
        """Return the largest log-likelihood ratio over windows that end at each sample."""
        level = np.sqrt(followed(np.minimum(white, 4.0) ** 2, good, self.level_s, period_s))
        values = np.where(good, np.clip(white / level, -self.clip, self.clip), 0.0)
        sums, squares, counts = (np.concatenate([[0.0], np.cumsum(each)]) for each in (values, values**2, good * 1.0))
        best = np.zeros(len(values))
        rows = 1
        while rows * period_s <= self.longest_s and rows < len(values):
            total, power, count = (np.zeros(len(values)) for _ in range(3))
            for of, each in zip((total, power, count), (sums, squares, counts), strict=True):
                of[rows - 1 :] = each[rows:] - each[:-rows]
            there = np.maximum(count, 1.0)
            shift = total**2 / (2.0 * there)
            ratio = np.maximum(power / there, 1.0)
            louder = there / 2.0 * (ratio - 1.0 - np.log(ratio)) if rows >= 8 else 0.0
            best = np.maximum(best, np.maximum(shift, self.loud * louder))
            rows *= 2
        return best


def equations(record: gb.Record, axis: int, lags: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the gyro's last readings times Ts, a one, and the increment, a row a sample; and which rows are whole."""
    frame = pd.DataFrame({name: record[name] for name in (*GYROS, *ANGLES)})
    gone = frame.isna().any(axis=1).to_numpy()
    run = gone.astype(int).cumsum() - pd.Series(np.where(gone, np.nan, gone.cumsum())).ffill().fillna(0).to_numpy()
    long = (run > FILLED).astype(float)
    good = pd.Series(long).rolling(lags + ORDER + 2, min_periods=1).max().to_numpy() == 0.0
    good &= ~gone
    good[: lags + ORDER + 1] = False
    values = frame.ffill().bfill().to_numpy()
    phi, theta = np.radians(values[:, 3]), np.radians(values[:, 4])
    d_phi, d_theta, d_psi = np.diff(values[:, 3:], axis=0, prepend=values[:1, 3:]).T
    turned = (
        d_phi - np.sin(theta) * d_psi,
        np.cos(phi) * d_theta + np.sin(phi) * np.cos(theta) * d_psi,
        -np.sin(phi) * d_theta + np.cos(phi) * np.cos(theta) * d_psi,
    )[axis]
    gyro = values[:, axis] * record.sample_period_s
    past = [np.concatenate([np.full(lag, gyro[0]), gyro[: len(gyro) - lag]]) for lag in range(lags + 1)]
    return np.column_stack([*past, np.full(len(gyro), record.sample_period_s), turned]), good


def autoregression(parts: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Return the coefficients that predict a residual from its last values, by least squares."""
    left, right = [], []
    for off, good in parts:
        past = np.column_stack([np.roll(off, lag) for lag in range(1, ORDER + 1)])
        left.append(past[good])
        right.append(off[good])
    return np.linalg.lstsq(np.vstack(left), np.hstack(right), rcond=None)[0]


def followed(squares: np.ndarray, good: np.ndarray, span_s: float, period_s: float) -> np.ndarray:
    """Return the mean square of the last seconds, the last half second left out; 1 at the beginning."""
    weight = period_s / span_s
    power = lfilter([weight], [1.0, weight - 1.0], np.where(good, squares, 0.0))
    count = lfilter([weight], [1.0, weight - 1.0], good * 1.0)
    late = round(LATE_S / period_s)
    prior = np.exp(-np.arange(len(squares)) * weight)
    level = (power + prior + 1e-9) / (count + prior + 1e-9)
    return np.concatenate([np.ones(late), level])[: len(squares)]


if __name__ == "__main__":
    print(__doc__)
