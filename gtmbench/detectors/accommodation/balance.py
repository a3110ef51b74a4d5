"""The balance: air data and accelerometers between a gyro and its angle, which of the two the flight path follows.

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
from collections.abc import Sequence

from gtmbench.detectors.accommodation.stand_in import COLUMNS, CarriedAngles, Readings
from gtmbench.values.channels import ATTITUDE, FT_S_PER_KT, G_FT_S2, GYROS

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
