"""What stands in for a sensor in flight: a rate from the attitude's slope, an angle that the gyros carry on.

Both are made sample by sample, of what is flown on, and say when they can't be relied upon any more.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

import numpy as np

from gtmbench.values.attitude_estimators import carried_on
from gtmbench.values.channels import ATTITUDE, FT_S_PER_KT, G_FT_S2, GYROS, SENSORS

COLUMNS = {name: column for column, name in enumerate(SENSORS)}
STALE_S = 0.3  # an attitude that hasn't changed for so long tells no rate
_GYROS = [COLUMNS[name] for name in GYROS]
_ANGLES = [COLUMNS[name] for name in ATTITUDE]
_SETTLE_S, _BEFORE_S = 0.5, 0.05  # readings that fix where an angle is carried on from, until so long before the onset
_LATEST_S, _LEAST_S = 0.25, 5.0  # of a lateness that is looked for, and of readings to find it
_STEEPEST_DEG = 80.0  # beyond, Euler angles aren't carried on
_AIDED_S = 20.0  # in how long the turn and the path correct a bank and a pitch
_SLOPE_S = 1.0  # over which a turn and a climb are told
_BIAS_DEG_S, _WALK_DEG_S = 0.1, 0.05  # what may be wrong with a healthy gyro: its bias, and its walk in deg/sqrt(s)

Readings = Sequence[float]


class VirtualRates:
    """Rates from the attitude: straight lines through its last fresh samples, and kinematics.

    p = phi' - psi' sin(theta), q = theta' cos(phi) + psi' cos(theta) sin(phi), r = psi' cos(theta) cos(phi) -
    theta' sin(phi). A sample is fresh where an angle changed: at 50 Hz in a loop of 100 Hz every other is.
    The line goes through those within the last `samples` periods, and at least through three.
    """

    def __init__(self, samples: int, sample_period_s: float) -> None:
        self._period_s, self._span_s = sample_period_s, (samples + 0.5) * sample_period_s
        self._least = min(samples, 3)
        self._fresh: deque[tuple[float, float, float, float]] = deque(maxlen=samples)  # a time, phi, theta, psi
        self._now_s = 0.0
        self._rates: tuple[float, float, float] | None = None

    def take(self, readings: Readings) -> None:
        """Take the next sample."""
        self._now_s += self._period_s
        phi, theta, psi = readings[_ANGLES[0]], readings[_ANGLES[1]], readings[_ANGLES[2]]
        if self._fresh:
            _, *last = self._fresh[-1]
            if phi == last[0] and theta == last[1] and psi == last[2]:
                return
        total = phi + theta + psi
        if total == total:  # nothing is missing
            self._fresh.append((self._now_s, phi, theta, psi))
            while len(self._fresh) > self._least and self._now_s - self._fresh[0][0] > self._span_s:
                self._fresh.popleft()
            self._rates = None

    @property
    def is_stale(self) -> bool:
        """Whether the attitude hasn't changed for too long, or there isn't enough of it."""
        return len(self._fresh) < self._least or self._now_s - self._fresh[-1][0] > STALE_S

    def rate(self, gyro: str) -> float:
        """Return what a gyro should read, in deg/s, as of half the samples ago; NaN where that isn't known."""
        if self.is_stale:
            return math.nan
        if self._rates is None:
            self._rates = self._computed()
        return self._rates[GYROS.index(gyro)]

    def _computed(self) -> tuple[float, float, float]:
        times = [row[0] for row in self._fresh]
        middle = sum(times) / len(times)
        about = [time_s - middle for time_s in times]
        spread = sum(value * value for value in about)
        slopes = []
        for angle in (1, 2, 3):
            # from step to step, for a heading may run from 360 deg to 0
            path = [0.0]
            for before, after in pairwise(self._fresh):
                path.append(path[-1] + (after[angle] - before[angle] + 180.0) % 360.0 - 180.0)
            slopes.append(sum(weight * value for weight, value in zip(about, path, strict=True)) / spread)
        phi, theta = math.radians(self._fresh[-1][1]), math.radians(self._fresh[-1][2])
        rolled, pitched, turned = slopes
        return (
            rolled - turned * math.sin(theta),
            pitched * math.cos(phi) + turned * math.cos(theta) * math.sin(phi),
            turned * math.cos(theta) * math.cos(phi) - pitched * math.sin(phi),
        )


def lateness_s(rows: Sequence[Readings], slope_samples: int, sample_period_s: float) -> float:
    """Return how much later the rates of an attitude are than its gyros, by where both agree best; inf if unknown.

    Samples of up to 0.25 s are compared, over all axes; below 5 s of readings nothing is known.
    """
    virtual = VirtualRates(slope_samples, sample_period_s)
    pairs = []
    for readings in rows:
        virtual.take(readings)
        if not virtual.is_stale:
            pairs.append([*(readings[column] for column in _GYROS), *(virtual.rate(name) for name in GYROS)])
    both = np.array(pairs)
    lags = round(_LATEST_S / sample_period_s)
    if len(both) * sample_period_s < _LEAST_S or np.isnan(both).any():
        return math.inf
    both -= both.mean(axis=0)
    stop = len(both) - lags
    together = [float(np.sum(both[:stop, :3] * both[lag : stop + lag, 3:])) for lag in range(lags)]
    return int(np.argmax(together)) * sample_period_s


class CarriedAngles:
    """Attitude angles carried on by the gyros from before a fault's onset.

    Over tens of seconds a bank is corrected by the turn, tan(phi) = V psi'/g, and a pitch by the path, theta = alpha +
    asin(h'/V); nothing corrects a heading. So the error that a healthy gyro may have made grows with time, a heading's
    without end.

    `rows`: the last samples, with their times, up to now. `onset_s`: from when on the angles aren't used. `angles`:
    which; the others are used as they are read. `tell`: called with each of the rows since the onset, and this as of
    then.
    """

    def __init__(
        self,
        rows: Sequence[tuple[float, Readings]],
        onset_s: float,
        angles: frozenset[str],
        sample_period_s: float,
        tell: Callable[[Readings, CarriedAngles], None] | None = None,
    ) -> None:
        self._period_s = sample_period_s
        self._which = [name in angles for name in ATTITUDE]
        self._slopes: deque[tuple[float, float]] = deque(maxlen=round(_SLOPE_S / sample_period_s))
        begin_s = onset_s - _BEFORE_S
        first = next((i for i, (time_s, _) in enumerate(rows) if time_s > begin_s), len(rows))
        first = max(first, 1)
        settling = rows[max(first - round(_SETTLE_S / sample_period_s), 0) : first]
        self._rates = [known(settling[0][1][column], 0.0) for column in _GYROS]
        self._angles = [known(settling[0][1][column], 0.0) for column in _ANGLES]
        self._since_s = 0.0
        off, count = [0.0, 0.0, 0.0], 0
        for _, readings in settling:
            self.step(readings, {})
            read = [readings[column] for column in _ANGLES]
            if not any(map(math.isnan, read)):
                off = [total + value - own for total, value, own in zip(off, read, self._angles, strict=True)]
                count += 1
        self._angles = [own + total / max(count, 1) for own, total in zip(self._angles, off, strict=True)]
        self._since_s = 0.0
        self.held = dict(zip(ATTITUDE, self._angles, strict=True))
        for _, readings in rows[first:]:
            self.step(readings, {})
            if tell is not None:
                tell(readings, self)

    def step(self, readings: Readings, rates: Mapping[str, float]) -> None:
        """Take the next sample; `rates` stand in for gyros that aren't to be used."""
        now = [
            known(rates.get(name, readings[column]), before)
            for name, column, before in zip(GYROS, _GYROS, self._rates, strict=True)
        ]
        start = [
            own if used else known(readings[column], own)
            for own, used, column in zip(self._angles, self._which, _ANGLES, strict=True)
        ]
        start[1] = max(-_STEEPEST_DEG, min(_STEEPEST_DEG, start[1]))
        self._angles = list(carried_on(start, self._rates, now, self._period_s))
        self._rates = now
        self._since_s += self._period_s
        self._aid(readings)

    def _aid(self, readings: Readings) -> None:
        speed = readings[COLUMNS["tas"]] * FT_S_PER_KT
        # a heading that has failed is told by its own carried angle: the turn is what the gyros say of it
        psi = self._angles[2] if self._which[2] else readings[COLUMNS["psi"]]
        self._slopes.append((psi, readings[COLUMNS["altitude"]]))
        if len(self._slopes) < (self._slopes.maxlen or 0) or not speed > 1.0:
            return
        span_s = (len(self._slopes) - 1) * self._period_s
        (psi_0, height_0), (psi_1, height_1) = self._slopes[0], self._slopes[-1]
        turn, climb = ((psi_1 - psi_0 + 180.0) % 360.0 - 180.0) / span_s, (height_1 - height_0) / span_s
        bank = math.degrees(math.atan(speed * math.radians(turn) / G_FT_S2))
        pitch = readings[COLUMNS["alpha"]] + math.degrees(math.asin(max(-1.0, min(1.0, climb / speed))))
        share = self._period_s / _AIDED_S
        for place, told in ((0, bank), (1, pitch)):
            if self._which[place] and told == told:
                self._angles[place] += share * (told - self._angles[place])

    def angle(self, name: str) -> float:
        """Return an angle as it is carried on, in deg."""
        return self._angles[ATTITUDE.index(name)]

    def error_deg(self, name: str) -> float:
        """Return how far an angle may be off by now, in deg: by a bias of 0.1 deg/s, and by the gyros' noise."""
        for_s = self._since_s if name == "psi" else min(self._since_s, _AIDED_S)
        return math.hypot(_BIAS_DEG_S * for_s, _WALK_DEG_S * math.sqrt(for_s))


def known(value: float, other: float) -> float:
    """Return a value, or where that is missing another."""
    return other if math.isnan(value) else value
