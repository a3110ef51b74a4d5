"""What sensors besides the gyros say of each other, block by block: relations, each between few sensors.

With C the rotation from body axes to north, east and down that the attitude tells, f the specific force, a = C f + g,
v the velocity over ground, u the velocity through the air by tas, alpha and beta, h the altitude and m the field:

    gps, accelerometers       v(t) less the integral of a        its rate of change
    air, accelerometers       C u less the integral of a         its rate of change
    gps, air                  v - C u                            its level: the wind
    gps, altitude             h plus the integral of v_down      its rate of change
    altitude, accelerometers  h plus the double integral of a    its second derivative
    field                     m                                  as iron turns C' F into it

Where all sensors are right each of them is linear in a few unknown constants: biases, the wind, the field and iron.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gtmbench.values.attitude import to_earth
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, FT_S_PER_KT, G_M_S2, GPS_VELOCITY, M_PER_FT, MAGNETOMETER
from gtmbench.values.record import FloatArray, Record

BLOCK_S = 0.2  # all are compared in means over blocks of that length
_M_S_PER_KT = FT_S_PER_KT * M_PER_FT

# the sensors that can be wrong, each as a whole; WIND is none, and may explain what the air says
MAG, GPS, ACCEL, TAS, ALPHA, BETA, ALTITUDE = (
    "magnetometer",
    "gps",
    "accelerometers",
    "tas",
    "alpha",
    "beta",
    "altitude",
)
ATT, WIND = "attitude", "wind"
CHANNELS: Mapping[str, tuple[str, ...]] = {
    MAG: MAGNETOMETER,
    GPS: GPS_VELOCITY,
    ACCEL: ACCELEROMETERS,
    TAS: ("tas",),
    ALPHA: ("alpha",),
    BETA: ("beta",),
    ALTITUDE: ("altitude",),
}


POSSIBLE: Mapping[str, tuple[str, ...]] = {  # relations, and what enters them; the attitude and the wind always may
    "gps, accelerometers": (GPS, ACCEL, ATT),
    "gps, altitude": (GPS, ALTITUDE),
    "gps, air": (GPS, TAS, ATT, WIND),
    "air, accelerometers": (TAS, ACCEL, ATT, WIND),
    "altitude, accelerometers": (ALTITUDE, ACCEL, ATT),
    "field strength": (MAG,),
    "field direction": (MAG, ATT),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Relation:
    """A relation on a record: y = X theta + e, block by block, and in which axes e is judged.

    Attributes
    ----------
    name : str
    axes : tuple of (str, sensors)
        Of each axis its name, and which sensors enter it.
    y : shape (blocks, axes)
        NaN where readings are missing.
    design : shape (blocks, axes, parameters)
        X.
    usual, spread : shape (parameters,)
        What the parameters usually are, and their standard deviations, before anything is learnt.
    frame : shape (blocks, axes, axes)
        Rotates e into the axes in which it is judged.
    least : tuple of float
        By axis: an error that is usual beside the noise, in the unit of y.
    is_length : bool
        Whether the first axis is judged by the length of what is read, of which 1 is usual, and not by its share in e.
    lasts : float
        For so many blocks errors are alike, so that so many teach the constants no more than one.
    force : shape (blocks,) or None
        The largest specific force that was read in what a block compares, in m/s2; None where nobody asks for it.
    """

    name: str
    axes: tuple[tuple[str, frozenset[str]], ...]
    y: FloatArray = field(repr=False)
    design: FloatArray = field(repr=False)
    usual: FloatArray = field(repr=False)
    spread: FloatArray = field(repr=False)
    frame: FloatArray = field(repr=False)
    least: tuple[float, ...]
    is_length: bool = False
    lasts: float = 10.0
    force: FloatArray | None = field(default=None, repr=False)


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """A record's rows as all relations need them; rows come last, so that each component lies in one piece.

    Attributes
    ----------
    record : Record
    blocks : int
        Of `BLOCK_S`.
    rows : int
        In a block.
    turned : shape (3, 3, rows)
        C; the last known attitude where one is missing.
    known : shape (rows,)
        Where the attitude is there.
    """

    record: Record
    blocks: int
    rows: int
    turned: FloatArray = field(repr=False)
    known: FloatArray = field(repr=False)

    @classmethod
    def of(cls, record: Record) -> Motion:
        """Return the motion of a record."""
        rows = max(round(BLOCK_S / record.sample_period_s), 1)
        attitude = _rows_last(record, ATTITUDE)
        known = np.isfinite(attitude).all(axis=0)
        turned = to_earth(np.deg2rad(_held(attitude)))
        return cls(record=record, blocks=len(record) // rows, rows=rows, turned=turned, known=known.astype(float))

    def mean(self, values: FloatArray, read: FloatArray | None = None) -> FloatArray:
        """Return means over blocks of values of shape (..., rows); blocks come first, NaN where none is read."""
        whole = self.blocks * self.rows
        shaped = values[..., :whole].reshape(*values.shape[:-1], self.blocks, self.rows)
        if read is None or read.all():
            return np.moveaxis(shaped.sum(axis=-1) / self.rows, -1, 0)
        weights = read[:whole].reshape(self.blocks, self.rows)
        return _means((shaped * weights).sum(axis=-1), weights.sum(axis=1))

    @cached_property
    def path(self) -> FloatArray:
        """The integral of a from the record's start, shape (3, rows)."""
        pulled = _turned(self.turned, self.force) + np.array([[0.0], [0.0], [G_M_S2]])
        return np.asarray(np.cumsum(pulled, axis=1) * self.record.sample_period_s)

    @cached_property
    def turning(self) -> FloatArray:
        """The integral of C from the record's start, shape (3, 3, rows)."""
        return np.asarray(np.cumsum(self.turned, axis=2) * self.record.sample_period_s)

    @cached_property
    def air_axes(self) -> FloatArray:
        """The axes of the air along north, east and down: along the way, across and normal to it; (3, 3, rows)."""
        (ca, sa), (cb, sb) = ((np.cos(each), np.sin(each)) for each in (self.flow(ALPHA), self.flow(BETA)))
        zero = np.zeros_like(ca)
        to_body = ([ca * cb, sb, sa * cb], [-ca * sb, cb, -sa * sb], [-sa, zero, ca])
        return np.array([_turned(self.turned, np.array(axis)) for axis in to_body])

    @cached_property
    def air_frame(self) -> FloatArray:
        """The rotation from north, east and down to the axes of the air, of each block's mean; (blocks, 3, 3)."""
        return self.mean(self.air_axes)

    @cached_property
    def through(self) -> FloatArray:
        """The velocity through the air along north, east and down, shape (3, rows)."""
        return np.asarray(self.air_axes[0] * (_column(self.record, TAS) * _M_S_PER_KT))

    @cached_property
    def turns_rad(self) -> FloatArray:
        """By how much the attitude turned since the block before, shape (blocks,)."""
        ends = self.turned[:, :, self.rows - 1 : self.blocks * self.rows : self.rows]
        traces = np.einsum("ijb,ijb->b", ends[:, :, 1:], ends[:, :, :-1])
        return np.concatenate([np.zeros(1), np.arccos(np.clip((traces - 1.0) / 2.0, -1.0, 1.0))])

    @property
    def force(self) -> FloatArray:
        """The specific force along body axes forward, right and down in m/s2, shape (3, rows)."""
        return _held(_rows_last(self.record, ACCELEROMETERS)) * [[G_M_S2], [G_M_S2], [-G_M_S2]]

    def flow(self, vane: str) -> FloatArray:
        """Return a vane's angle in rad; zeros where there is none."""
        return np.asarray(np.deg2rad(_column(self.record, vane)))

    def there(self, *sensors: str) -> FloatArray:
        """Tell in which rows sensors and the attitude are read, as 1 and 0."""
        names = [name for sensor in sensors for name in CHANNELS[sensor] if name in self.record]
        return np.asarray(np.logical_and.reduce([np.isfinite(self.record[name]) for name in names]) * self.known)


def relations(motion: Motion, delay_s: float, field_ned: FloatArray | None) -> Iterator[Relation]:
    """Give the relations that a record's channels allow.

    Parameters
    ----------
    motion : Motion
    delay_s : float
        How late the GPS is.
    field_ned : shape (3,) or None
        The field along north, east and down, roughly; None where there is no magnetometer.
    """
    sensors = {name for name, channels in CHANNELS.items() if set(channels) <= set(motion.record.channels)}
    late = Late.of(motion, delay_s) if GPS in sensors else None
    if late is not None and not len(late.rows):
        late = None
    if late is not None and ACCEL in sensors:
        yield _gps_and_force(motion, late)
    if late is not None and ALTITUDE in sensors:
        yield _gps_and_altitude(motion, late)
    if late is not None and TAS in sensors:
        yield _gps_and_air(motion, late)
    if {ACCEL, TAS} <= sensors:
        yield _air_and_force(motion)
    if {ACCEL, ALTITUDE} <= sensors:
        yield _altitude_and_force(motion)
    if MAG in sensors and field_ned is not None:
        yield _field(motion, field_ned)


@dataclass(frozen=True, kw_only=True, eq=False)
class Late:
    """The rows with a reading of the GPS, and which rows these tell of.

    Attributes
    ----------
    rows, at : shape (readings,)
    velocity : shape (3, readings)
    """

    rows: NDArray[np.int64] = field(repr=False)
    at: NDArray[np.int64] = field(repr=False)
    velocity: FloatArray = field(repr=False)

    @classmethod
    def of(cls, motion: Motion, delay_s: float) -> Late:
        """Return the readings of a motion's GPS, but for those that tell of the time before the record."""
        velocity = _rows_last(motion.record, GPS_VELOCITY)
        late = round(delay_s / motion.record.sample_period_s)
        rows = np.flatnonzero(np.isfinite(velocity).all(axis=0))
        rows = rows[rows >= late]
        return cls(rows=rows, at=rows - late, velocity=velocity[:, rows])

    def mean(self, motion: Motion, values: FloatArray, read: FloatArray) -> FloatArray:
        """Return means over blocks of values of shape (..., readings); NaN where none of a block is read.

        Parameters
        ----------
        motion : Motion
        values : FloatArray
        read : shape (rows,)
            What has to be there in the row of a reading.
        """
        weights = read[self.rows] * motion.known[self.rows]
        within = self.rows < motion.blocks * motion.rows
        block = self.rows[within] // motion.rows
        flat = (values * weights)[..., within].reshape(math.prod(values.shape[:-1]), len(block))
        sums = np.array([np.bincount(block, each, minlength=motion.blocks) for each in flat])
        counts = np.bincount(block, weights[within], minlength=motion.blocks).astype(np.float64)
        return _means(sums.reshape(*values.shape[:-1], motion.blocks), counts)


def gps_delay_s(motion: Motion) -> float:
    """Return by how much the GPS is late, as the accelerometers tell; 0.15 s where they can't."""
    sensors = [name for name in (GPS, ACCEL) if set(CHANNELS[name]) <= set(motion.record.channels)]
    if len(sensors) < 2:
        return _USUAL_DELAY_S
    left = []
    for delay_s in _DELAYS_S:
        late = Late.of(motion, float(delay_s))
        changes = _changes(late.mean(motion, late.velocity - motion.path[:, late.at], motion.known))
        changes = changes[np.isfinite(changes).all(axis=1)]
        if len(changes) < 2:  # no fix yet
            return _USUAL_DELAY_S
        left.append(np.mean(np.var(changes, axis=0)))
    return float(_DELAYS_S[int(np.argmin(left))])


_USUAL_DELAY_S = 0.15
_DELAYS_S = np.arange(0.0, 0.5, 0.02)


def _gps_and_force(motion: Motion, late: Late) -> Relation:
    read = motion.there(ACCEL)
    y = _changes(late.mean(motion, late.velocity - motion.path[:, late.at], read))
    biases = _changes(late.mean(motion, motion.turning[:, :, late.at], read))
    return Relation(
        name="gps, accelerometers",
        axes=tuple((f"gps, accelerometers: {axis}", frozenset({GPS, ACCEL, ATT})) for axis in _NED),
        y=y,
        design=-np.concatenate([biases, _eyes(y)], axis=2),
        usual=np.zeros(6),
        spread=np.array([_BIAS] * 3 + [_COARSE] * 3),
        frame=_eyes(y),
        least=(_TILTED, _TILTED, 0.2),
    )


def _gps_and_altitude(motion: Motion, late: Late) -> Relation:
    period_s = motion.record.sample_period_s
    down = late.velocity[2]
    at_s = late.rows * period_s
    sunk = np.concatenate([[0.0], np.cumsum(np.diff(at_s) * (down[1:] + down[:-1]) / 2.0)])
    rows = np.arange(len(motion.record))
    last = np.clip(np.cumsum(np.bincount(late.rows, minlength=len(rows))) - 1, 0, None)
    carried = sunk[last] + (rows - late.rows[last]) * period_s * down[last]  # on, by the last reading
    behind = rows - (late.rows[0] - late.at[0])
    height = _column(motion.record, ALTITUDE)[np.maximum(behind, 0)] * M_PER_FT
    seen = late.mean(motion, np.zeros(len(late.rows)), np.ones(len(rows)))
    y = (
        _changes(motion.mean(height + carried, motion.there(ALTITUDE) * (behind >= 0)))[:, np.newaxis]
        + seen[:, np.newaxis]
    )
    return Relation(
        name="gps, altitude",
        axes=(("gps, altitude", frozenset({GPS, ALTITUDE})),),
        y=y,
        design=np.ones((motion.blocks, 1, 1)),
        usual=np.zeros(1),
        spread=np.array([0.3]),
        frame=_eyes(y),
        least=(0.3,),
    )


def _gps_and_air(motion: Motion, late: Late) -> Relation:
    read = motion.there(TAS, *_vanes(motion))
    air = motion.through[:, late.at]
    y = late.mean(motion, late.velocity - air, read)
    scale = late.mean(motion, air, read)[:, :, np.newaxis]
    turned = late.mean(motion, motion.turned[:, :, late.at], read)
    return Relation(
        name="gps, air",
        axes=tuple((f"gps, air: {axis}", frozenset({GPS, sensor, ATT, WIND})) for axis, sensor in _air_axes(motion)),
        y=y,
        design=np.concatenate([_eyes(y), scale, turned], axis=2),
        usual=np.zeros(7),
        spread=np.array([15.0, 15.0, 1.0, 0.05, 1.0, 1.0, 1.0]),
        frame=motion.air_frame,
        least=(1.0, _SLIPPED, _SLIPPED),
    )


def _air_and_force(motion: Motion) -> Relation:
    read = motion.there(ACCEL, TAS, *_vanes(motion))
    y = _changes(motion.mean(motion.through - motion.path, read))
    biases = _changes(motion.mean(motion.turning, read))
    return Relation(
        name="air, accelerometers",
        axes=tuple(  # an error of the airspeed shows in all of them, where the aircraft turns
            (f"air, accelerometers: {axis}", frozenset({ACCEL, sensor, TAS, ATT, WIND}))
            for axis, sensor in _air_axes(motion)
        ),
        y=y,
        design=np.concatenate([-biases, -_eyes(y)], axis=2),  # no scale of tas: gusts, in its changes, look like one
        usual=np.zeros(6),
        spread=np.array([_BIAS] * 3 + [_COARSE] * 3),
        frame=motion.air_frame,
        least=(_TILTED, _TILTED, _TILTED),
    )


def _altitude_and_force(motion: Motion) -> Relation:
    period_s = motion.record.sample_period_s
    fallen = np.cumsum(motion.path[2]) * period_s
    height = _column(motion.record, ALTITUDE) * M_PER_FT
    read = motion.there(ACCEL, ALTITUDE)
    # of the times at which the altitude is read: beside a wrong force its sum soon runs away by tens of metres a row
    at_s = motion.mean(np.arange(len(motion.record), dtype=np.float64) * period_s, read)
    y = _curvatures(motion.mean(height + fallen, read)[:, np.newaxis], at_s)
    biases = _curvatures(motion.mean(np.cumsum(motion.turning[2], axis=1) * period_s, read), at_s)
    return Relation(
        name="altitude, accelerometers",
        axes=(("altitude, accelerometers", frozenset({ALTITUDE, ACCEL, ATT})),),
        y=y,
        design=np.concatenate([biases, np.ones((motion.blocks, 1))], axis=1)[:, np.newaxis, :],
        usual=np.zeros(4),
        spread=np.array([_BIAS] * 3 + [_COARSE]),
        frame=_eyes(y),
        least=(0.3,),
        force=_largest_force(motion),
    )


def _largest_force(motion: Motion) -> FloatArray:
    """Return the largest specific force of each block and the two before it, of which second differences are."""
    size = np.linalg.norm(motion.force[:, : motion.blocks * motion.rows], axis=0)
    own = size.reshape(motion.blocks, motion.rows).max(axis=1)
    before = np.concatenate([own[:1], own[:1], own])
    return np.asarray(np.maximum.reduce([before[:-2], before[1:-1], own]))


def _field(motion: Motion, field_ned: FloatArray) -> Relation:
    """Return how the field is read, as a share of its strength; iron makes of it anything linear in C."""
    strength = float(np.linalg.norm(field_ned))
    told = field_ned / strength
    raw = _rows_last(motion.record, MAGNETOMETER)
    read = np.isfinite(raw).all(axis=0) * motion.known
    y = motion.mean(np.nan_to_num(raw) / strength, read)
    turned = motion.mean(motion.turned, read)
    elements = np.concatenate([turned.reshape(-1, 9), np.ones((motion.blocks, 1))], axis=1)
    design = np.zeros((motion.blocks, 3, 30))
    usual = np.zeros(30)
    for axis in range(3):
        design[:, axis, 10 * axis : 10 * axis + 10] = elements
        usual[10 * axis + axis + 3 * np.arange(3)] = told  # element (n, axis) of C, by the field along n
    first = np.cross(told, [0.0, 1.0, 0.0] if abs(told[1]) < 0.9 else [1.0, 0.0, 0.0])
    first /= np.linalg.norm(first)
    basis = np.array([told, first, np.cross(told, first)])
    return Relation(
        name="field",
        axes=(
            ("field strength", frozenset({MAG})),
            ("field direction", frozenset({MAG, ATT})),
            ("field direction, across", frozenset({MAG, ATT})),
        ),
        y=y,
        design=design,
        usual=usual,
        spread=np.tile([0.1] * 9 + [0.2], 3),
        frame=basis @ turned,
        least=(0.04, _OFF_RAD, _OFF_RAD),
        is_length=True,
        lasts=_OFF_BLOCKS,
    )


_PART = 0.5  # of the readings that a block usually has
_NED = ("north", "east", "down")
# an attitude that gyros drive may be off by 5 deg on a healthy day, which turns gravity, the air and the field
_OFF_RAD = 0.0873
_OFF_BLOCKS = 100.0  # for 20 s, in which iron at the headings that it has learns it
_TILTED, _SLIPPED = _OFF_RAD * G_M_S2, 4.5  # m/s2, m/s
_BIAS, _COARSE = 0.3, 0.05  # m/s2: of an accelerometer; of gravity, and of a round Earth that turns


def _vanes(motion: Motion) -> tuple[str, ...]:
    return tuple(name for name in (ALPHA, BETA) if name in motion.record)


def _air_axes(motion: Motion) -> tuple[tuple[str, str], ...]:
    """Return the axes of the air, and the sensor that each is read by; without a vane, the wind's only."""
    return (
        ("along", TAS),
        ("across", BETA if BETA in motion.record else WIND),
        ("normal", ALPHA if ALPHA in motion.record else WIND),
    )


def _changes(levels: FloatArray) -> FloatArray:
    """Return rates of change from block to block; none before the first."""
    changes = np.full_like(levels, np.nan)
    changes[1:] = (levels[1:] - levels[:-1]) / BLOCK_S
    return changes


def _curvatures(levels: FloatArray, at_s: FloatArray) -> FloatArray:
    """Return second derivatives from each block to the next but one, of levels at uneven times; none before the third.

    With t the times, s = t(k) - t(k-1) and v(k) = (y(k) - y(k-1)) / s(k), they are 2 (v(k) - v(k-1)) / (s(k) + s(k-1)).
    """
    steps = np.diff(at_s)[:, np.newaxis]
    rates = np.diff(levels, axis=0) / steps
    found = np.full_like(levels, np.nan)
    found[2:] = 2.0 * np.diff(rates, axis=0) / (steps[1:] + steps[:-1])
    return found


def _eyes(y: FloatArray) -> FloatArray:
    return np.tile(np.eye(y.shape[1]), (len(y), 1, 1))


def _means(sums: FloatArray, counts: FloatArray) -> FloatArray:
    """Return sums of shape (..., blocks) over counts, blocks first; NaN where less than half of the usual was counted.

    A mean of few readings, as where a record begins within a block, is noisier than those that were learnt.
    """
    usual = float(np.median(counts[counts > 0.0])) if counts.any() else 1.0
    means = sums / np.maximum(counts, 1.0)
    means[..., counts < _PART * usual] = np.nan
    return np.moveaxis(means, -1, 0)


def _turned(rotation: FloatArray, vector: FloatArray) -> FloatArray:
    """Return vectors (3, rows) turned by rotations (3, 3, rows)."""
    return np.array([each[0] * vector[0] + each[1] * vector[1] + each[2] * vector[2] for each in rotation])


def _rows_last(record: Record, channels: Sequence[str]) -> FloatArray:
    return np.array([record[name] for name in channels])


def _column(record: Record, name: str) -> FloatArray:
    """Return a channel, its last value where it is missing; zeros where it isn't there."""
    return _held(record[name][np.newaxis])[0] if name in record else np.zeros(len(record))


def _held(values: FloatArray) -> FloatArray:
    """Return channels of shape (channels, rows) with their last value where one is missing, before it the first."""
    there = np.isfinite(values)
    if there.all():
        return values
    last = np.maximum.accumulate(np.where(there, np.arange(values.shape[1]), -1), axis=1)
    first = np.argmax(there, axis=1)[:, np.newaxis]
    return np.nan_to_num(np.take_along_axis(values, np.where(last < 0, first, last), axis=1))
