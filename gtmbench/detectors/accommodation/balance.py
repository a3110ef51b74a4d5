"""The balance: air data and accelerometers between a gyro and its angle, which of the two the flight path follows.

A gyro and its angle explain each other's faults. A third witness is what the path must do. With V the airspeed, n the
specific force in g, and changes since the onset,

    theta - alpha = (g/V) int (nz - cos(theta) cos(phi)) dt,
    psi + beta - alpha_0 phi = (g/V) int (ny + cos(theta) sin(phi)) dt,

the first balance tells whether theta is as read or as q carries it on, the second the same of psi and r, and, by the
bank that turns it, of phi and p. Gusts put a few degrees into alpha and beta, so a balance decides on large differences
only, and within seconds of the onset: its integrals drift.
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
