"""What stands in for a sensor in flight, and what decides: rates, carried angles, the flight path's balance, a guard.

A rate comes from the attitude's slope, an angle is carried on by the gyros. Both are made sample by sample, of what is
flown on, and say when they can't be relied upon any more.

The balance: air data and accelerometers between a gyro and its angle, which of the two the flight path follows.

A gyro and its angle explain each other's faults. A third witness is what the path must do. With V the airspeed, n the
specific force in g, and changes since the onset,

    theta - alpha = (g/V) int (nz - cos(theta) cos(phi)) dt,
    psi + beta - alpha_0 phi = (g/V) int (ny + cos(theta) sin(phi)) dt,

the first balance tells whether theta is as read or as q carries it on, the second the same of psi and r, and, by the
bank that turns it, of phi and p. Gusts put a few degrees into alpha and beta, so a balance decides on large differences
only, and within seconds of the onset: its integrals drift.

A guard between alarms: what no gyro of this flight has read so far.

A monitor's test needs the attitude, which is late, and means over tens of milliseconds; a damper that a broken gyro
drives throws the aircraft in two tenths of a second. Two things are seen at once: a reading that jumps within a sample,
and one far beyond any before. How far both went on this flight until a second ago is learnt, and several times as far
is beyond it; so what grows within a second isn't taken for what is usual. A guard names nobody: a gyro that is beyond
is heard, for half a second, only as far as the attitude agrees.
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


LASTS_S = 4.0  # after the onset
_SMOOTHED_S = 0.1  # a balance, against noise
_SURE_S = 0.4  # for how long it must contradict an angle: to fly on a broken gyro is worse than on a broken angle
_WRONG_DEG, _TIMES = 5.0, 3.0  # how far the wrong one is off at least, and how many times as far as the right one
_USED = [COLUMNS[name] for name in ("alpha", "beta", "phi", "theta", "psi", "ny", "nz", "tas")]


class Balance:
    """The balances since an onset, for angles as read and as the gyros carry them on.

    `before`: the samples that end with the onset, over which what changes is averaged.
    """

    def __init__(self, before: Sequence[Readings], sample_period_s: float) -> None:
        self._period_s = sample_period_s
        rows = [row for row in before if not any(math.isnan(row[column]) for column in _USED)]
        self._start = [sum(row[column] for row in rows) / len(rows) for column in _USED] if rows else []
        self._path = [0.0, 0.0]  # integrals of the first balance and the second, in deg
        self._carried_path = 0.0  # of the second, with the bank as p carries it on
        self._since_s = 0.0
        self._off: dict[str, tuple[float, float]] = {}
        self._against_s: dict[str, float] = {}  # for how long an angle as read has been contradicted

    def take(self, readings: Readings, carried: CarriedAngles) -> None:
        """Take the next sample, and the angles as raw gyros carry them on."""
        alpha, beta, phi, theta, psi, ny, nz, tas = (readings[column] for column in _USED)
        total = alpha + beta + phi + theta + psi + ny + nz + tas
        if not self._start or total != total or not tas > 1.0:
            self._since_s = math.inf
            return
        self._since_s += self._period_s
        step = self._period_s * math.degrees(G_FT_S2 / (tas * FT_S_PER_KT))
        bank, pitch = math.radians(phi), math.radians(theta)
        own_bank = math.radians(carried.angle("phi"))
        self._path[0] += step * (nz - math.cos(pitch) * math.cos(bank))
        self._path[1] += step * (ny + math.cos(pitch) * math.sin(bank))
        self._carried_path += step * (ny + math.cos(pitch) * math.sin(own_bank))
        alpha_0, beta_0, phi_0, theta_0, psi_0 = self._start[:5]
        climbed = theta_0 + alpha - alpha_0 + self._path[0]
        incidence = math.radians(alpha_0)
        slipped = psi_0 - (beta - beta_0)
        turned = slipped + incidence * (phi - phi_0) + self._path[1]
        own_turned = slipped + incidence * (carried.angle("phi") - phi_0) + self._carried_path
        share = min(self._period_s / _SMOOTHED_S, 1.0)
        for angle, now in (
            ("phi", (psi - turned, psi - own_turned)),
            ("theta", (theta - climbed, carried.angle("theta") - climbed)),
            ("psi", (psi - turned, carried.angle("psi") - turned)),
        ):
            read, own = self._off.get(angle, (0.0, 0.0))
            read, own = read + share * (now[0] - read), own + share * (now[1] - own)
            self._off[angle] = read, own
            against = abs(read) > max(_WRONG_DEG, _TIMES * abs(own))
            self._against_s[angle] = self._against_s.get(angle, 0.0) + self._period_s if against else 0.0

    def wrong(self, angle: str) -> str | None:
        """Return which of an angle and its gyro the path contradicts; None: neither decisively, or it is too late."""
        if angle not in self._off or self._since_s > LASTS_S:
            return None
        read, carried = map(abs, self._off[angle])
        if carried > max(_WRONG_DEG, _TIMES * read):
            return GYROS[ATTITUDE.index(angle)]
        return angle if self._against_s[angle] >= _SURE_S else None


_LEARNT_S = 10.0  # at least, before anything is beyond it
_BLOCK_S = 1.0  # what came within the last one or two isn't learnt yet
_JUMP_TIMES, _LEVEL_TIMES = 4.0, 2.5  # the greatest so far
_LEAST_JUMP_DEG_S, _LEAST_LEVEL_DEG_S = 5.0, 8.0  # where a flight has hardly moved so far
_COLUMNS = [(name, COLUMNS[name]) for name in GYROS]


class Guard:
    """The guard of one flight, sample by sample.

    >>> guard = Guard(sample_period_s=0.01)
    >>> calm = [0.5, -0.5, 0.2] + [0.0] * 10
    >>> any(guard.take(calm, is_learning=True) for _ in range(1100))
    False
    >>> guard.take([0.5, 100.0, 0.2] + [0.0] * 10, is_learning=True)
    {'q'}
    """

    def __init__(self, sample_period_s: float) -> None:
        self._learning, self._block = round(_LEARNT_S / sample_period_s), round(_BLOCK_S / sample_period_s)
        self._last = dict.fromkeys(GYROS, 0.0)
        self._learnt, self._before, self._now = (_Most() for _ in range(3))
        self._in_block = 0

    def take(self, readings: Readings, *, is_learning: bool) -> set[str]:
        """Take the next sample, and return the gyros beyond what they did; learn of it where nothing is distrusted."""
        beyond: set[str] = set()
        for name, column in _COLUMNS:
            reading = readings[column]
            if reading != reading:  # missing
                continue
            level, jump = abs(reading), abs(reading - self._last[name])
            self._last[name] = reading
            if self._learning <= 0 and (
                jump > max(_LEAST_JUMP_DEG_S, _JUMP_TIMES * self._learnt.jumps[name])
                or level > max(_LEAST_LEVEL_DEG_S, _LEVEL_TIMES * self._learnt.levels[name])
            ):
                beyond.add(name)
            self._now.take(name, jump, level)
        if beyond or not is_learning:
            self._before, self._now, self._in_block = _Most(), _Most(), 0
            return beyond
        self._in_block += 1
        if self._in_block == self._block:
            self._learning -= self._block
            for name in GYROS:
                self._learnt.take(name, self._before.jumps[name], self._before.levels[name])
            self._before, self._now, self._in_block = self._now, _Most(), 0
        return beyond


class _Most:
    """The greatest jump and level of every gyro."""

    def __init__(self) -> None:
        self.jumps, self.levels = dict.fromkeys(GYROS, 0.0), dict.fromkeys(GYROS, 0.0)

    def take(self, name: str, jump: float, level: float) -> None:
        """Take a jump and a level of a gyro."""
        if jump > self.jumps[name]:
            self.jumps[name] = jump
        if level > self.levels[name]:
            self.levels[name] = level
