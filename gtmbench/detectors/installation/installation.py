"""How gyros and attitude are installed: matrix, bias, lag and clocks of a record that is healthy, and its undoing.

A gyro of an autopilot may read 3 % too much, sit 2 deg off its axis, and have its attitude 40 ms late from a clock of
its own. None of this is a fault; a change of it is. With w the true rates, a the body rates that the attitude's slopes
give, and t(k) = late + drift time,

    gyro(k) = (I + E) w(k) + bias,    a(k) = w(k - t),    gyro(k) - a(k) = E a(k) + t a'(k) + bias + noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import FloatArray, Record

_SAID_BIAS = 0.1  # deg/s
_LEFT_S, _LEFT = 0.015, (0.55, 1.5)  # by which rates may carry the attitude on or back; in samples, at least and most
_ACROSS_S = 0.02  # over which the attitude tells the rates of other axes

Rows = np.ndarray[tuple[int], np.dtype[np.int_]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Installation:
    """How gyros and attitude of a record are installed, as far as it shows.

    >>> gyros = np.eye(3) + [[0.012, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
    >>> Installation(gyros=gyros, late_s=0.005, drift=1e-4).said
    ('attitude 5 ms late', 'clocks 100 ppm apart', 'p reads 1.2 % high')
    >>> Installation().is_plain
    True
    """

    gyros: FloatArray = field(default_factory=lambda: np.eye(3))  # shape (3, 3): what p, q, r read of the true rates
    # shape (3,): in deg/s. It is said, not undone: detectors compare means with those before
    bias: FloatArray = field(default_factory=lambda: np.zeros(3))
    late_s: float = 0.0  # how late the attitude is against the gyros at `since_s`; below 0 the gyros are
    drift: float = 0.0  # what it is later by in each second: the clocks' rates differ
    since_s: float = 0.0

    @property
    def is_plain(self) -> bool:
        """Whether there is nothing to undo."""
        return not (self.late_s or self.drift or np.any(self.gyros != np.eye(3)))

    def late_at(self, time_s: FloatArray) -> FloatArray:
        """Return how late the attitude is at some times, in seconds."""
        return self.late_s + self.drift * (time_s - self.since_s)

    @property
    def said(self) -> tuple[str, ...]:
        """What is to be undone, and biases, in words."""
        words = []
        if self.late_s:
            words.append(f"{'attitude' if self.late_s > 0.0 else 'gyros'} {1e3 * abs(self.late_s):.2g} ms late")
        if self.drift:
            words.append(f"clocks {1e6 * abs(self.drift):.0f} ppm apart")
        for place, name in enumerate(GYROS):
            scale = self.gyros[place, place] - 1.0
            off = float(np.degrees(np.arctan(np.linalg.norm(np.delete(self.gyros[place], place)))))
            if scale:
                words.append(f"{name} reads {100.0 * abs(scale):.1f} % {'high' if scale > 0.0 else 'low'}")
            if off:
                words.append(f"axis of {name} {off:.1f} deg off")
        words += [
            f"{name} reads {value:.1f} deg/s at rest"
            for name, value in zip(GYROS, self.bias.tolist(), strict=True)
            if abs(value) >= _SAID_BIAS
        ]
        return tuple(words)

    def table(self) -> Mapping[str, object]:
        """Return it as plain values, in s, deg/s and parts."""
        return {
            "gyros": self.gyros.tolist(),
            "bias_deg_s": self.bias.tolist(),
            "late_s": self.late_s,
            "drift": self.drift,
            "since_s": self.since_s,
            "said": list(self.said),
        }

    def undone(self, record: Record, rows: range, waited: int = 0) -> tuple[Record, int]:
        """Return some rows of a record as sensors would read that are installed plainly, and what they ended with.

        What is early waits for whole samples: a fault shows no earlier than the later of the two tells it. By what is
        left, less than two samples, the attitude goes on with its rates by the gyros: no noise is averaged away. Where
        more or fewer samples have to be waited for than before, clocks being apart, a row's attitude is missing.

        `waited`: samples that the row before `rows` had waited for; below 0 the attitude's.
        """
        if self.is_plain and not waited:
            return record.part(rows), 0
        period_s = record.sample_period_s
        at = np.arange(rows.start, rows.stop)
        late = self.late_at(np.asarray(record.start_s + at * period_s, dtype=np.float64)) / period_s
        # lag in samples = whole ones, waited for, and what is left, below two, undone by rates
        whole = _waited(late, waited, float(np.clip(_LEFT_S / period_s, *_LEFT)))
        gyros, angles = record.matrix(GYROS), record.matrix(ATTITUDE)
        told, before = at - np.maximum(whole, 0), at + np.minimum(whole, 0)
        # rates half-way between what the attitude tells and where it has to go: of these two rows
        half = 0.5 * (late - whole)
        steps = np.minimum(np.floor(half), np.maximum(whole, 0)).astype(int)
        newer = _at_rows(gyros, told - steps)
        # between two rows: linear
        between = newer + (half - steps)[:, np.newaxis] * (_at_rows(gyros, told - steps - 1) - newer)
        # what a gyro reads of the other axes, from differences of the attitude, which holds no gyro's fault
        read = _at_rows(angles, before)
        back = max(1, round(_ACROSS_S / period_s))
        seen = [read, *(_at_rows(angles, before - times * back) for times in (1, 2))]
        other = self._of_other_axes(seen, back * period_s)
        own = np.diag(self.gyros)
        slopes = _slopes((between - other) / own, read)
        # the attitude goes on by dt times its rates (phi', theta', psi' of the gyros' own p, q, r)
        moved = read + (late - whole)[:, np.newaxis] * period_s * np.nan_to_num(slopes)
        moved[np.diff(whole, prepend=waited) != 0] = np.nan
        part = record.part(rows)
        # a gyro's reading is E (p, q, r): its own axis over the scale, less the other axes' part
        values = np.array(part.values, order="F")
        values[:, part.columns(GYROS)] = (_at_rows(gyros, told) - other) / own
        values[:, part.columns(ATTITUDE)] = moved
        there = np.array(part.there)
        for names, taken in ((GYROS, told), (ATTITUDE, before)):  # beside a pause a sample is there, if not known
            there[:, part.columns(names)] = _at_rows(record.select(names).there.astype(np.float64), taken) == 1.0
        known = None if np.array_equal(there, np.isfinite(values)) else there  # a stream takes such rows faster
        corrected = Record(values, channels=part.channels, sample_period_s=period_s, start_s=part.start_s, there=known)
        return corrected, int(whole[-1])

    def _of_other_axes(self, angles: Sequence[FloatArray], since_s: float) -> FloatArray:
        """Return what every gyro reads of the other axes' rates, by the attitude: no gyro's fault enters another.

        `angles` are those of now, and of twice so long before; their parabola's slope is that of now.
        """
        across = self.gyros - np.diag(np.diag(self.gyros))
        if not across.any():
            return np.zeros((len(angles[0]), 3))
        newest, before = (one - other for one, other in pairwise(angles))
        newest, before = (turned - 360.0 * np.rint(turned / 360.0) for turned in (newest, before))
        slopes = (1.5 * newest - 0.5 * before) / since_s
        return np.asarray(np.nan_to_num(_rates(slopes, angles[0])) @ across.T)


def _waited(late: FloatArray, waited: int, most: float) -> Rows:
    """Return how many samples each row waits for: as the one before, as long as what is left is at most so much."""
    whole = np.full(len(late), waited)
    row = 0
    while row < len(late):
        beyond = np.flatnonzero(np.abs(late[row:] - whole[row]) > most)
        if not len(beyond):
            break
        row += int(beyond[0])
        whole[row:] = round(float(late[row]))
    return whole


def _at_rows(columns: FloatArray, rows: Rows) -> FloatArray:
    """Return some rows, NaN where there is none."""
    there = (rows >= 0) & (rows < len(columns))
    return np.where(there[:, np.newaxis], columns[np.clip(rows, 0, len(columns) - 1)], np.nan)


def _rates(slopes: FloatArray, angles: FloatArray) -> FloatArray:
    """Return body rates of phi', theta', psi'."""
    phi_slope, theta_slope, psi_slope = slopes.T
    phi, theta, _ = np.deg2rad(angles).T
    level = psi_slope * np.cos(theta)
    return np.column_stack(
        [
            phi_slope - psi_slope * np.sin(theta),
            theta_slope * np.cos(phi) + level * np.sin(phi),
            level * np.cos(phi) - theta_slope * np.sin(phi),
        ]
    )


def _slopes(gyros: FloatArray, angles: FloatArray) -> FloatArray:
    """Return phi', theta', psi' of body rates."""
    p, q, r = gyros.T
    phi, theta, _ = np.deg2rad(angles).T
    across = q * np.sin(phi) + r * np.cos(phi)
    level = np.where(np.abs(np.cos(theta)) > 0.05, np.cos(theta), np.nan)
    return np.column_stack([p + across * np.sin(theta) / level, q * np.cos(phi) - r * np.sin(phi), across / level])
