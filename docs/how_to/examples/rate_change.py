"""A detector for gtmbench-1 in 30 lines: how much a gyro differs from the rate of its angle, squared.

gtmbench benchmark --quick --detector rate_change.py:RateChange
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

import gtmbench as gb

PAIRS = {"p": "phi", "q": "theta", "r": "psi"}


def held(values):  # a lost sample repeats the last
    return values[np.maximum.accumulate(np.where(np.isnan(values), 0, np.arange(len(values))))]


@dataclass(frozen=True)
class RateChange(gb.ScoreDetector):
    name: str = "rate-change"
    channels: tuple[str, ...] = (*PAIRS, *PAIRS.values())
    span_s: float = 1.0

    def learn(self, records):  # of healthy flights: what the differences are
        return {gyro: float(np.nanstd(np.concatenate([self.off(one, gyro) for one in records]))) for gyro in PAIRS}

    def scores(self, record, deviations):  # large is bad; the benchmark finds how large
        return {gyro: (self.off(record, gyro) / deviations[gyro]) ** 2 for gyro in PAIRS}

    def off(self, record, gyro):  # the gyro's mean over the last second less what the angle did in it
        rows = round(self.span_s / record.sample_period_s)
        rate, angle = (held(record[name]) for name in (gyro, PAIRS[gyro]))
        off = lfilter(np.ones(rows) / rows, [1.0], rate)
        off[rows:] -= (angle[rows:] - angle[:-rows]) / self.span_s
        off[:rows] = 0.0
        return off
