"""A detector for gtmbench-2 in 18 lines: gtmbench benchmark --quick --detector rate_change.py:RateChange."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

import gtmbench as gb

PAIRS = {"p": "phi", "q": "theta", "r": "psi"}


@dataclass(frozen=True)
class RateChange(gb.ScoreDetector):
    name: str = "rate-change"
    channels: tuple[str, ...] = (*PAIRS, *PAIRS.values())

    def learn(self, records):  # of healthy flights: how much gyros and angles differ
        return {gyro: float(np.std(np.concatenate([off(one, gyro) for one in records]))) for gyro in PAIRS}

    def scores(self, record, deviations):  # large is bad; the benchmark finds how large
        return {gyro: (off(record, gyro) / deviations[gyro]) ** 2 for gyro in PAIRS}


def off(record, gyro):  # the gyro's mean over the last second less what the angle did in it
    rows = round(1.0 / record.sample_period_s)
    rate, angle = (pd.Series(record[name]).ffill() for name in (gyro, PAIRS[gyro]))  # a lost sample repeats the last
    return (rate.rolling(rows).mean() - angle.diff(rows)).fillna(0.0).to_numpy()
