"""A flight's course as other sensors read it, in the blocks of gyros and attitude; and how it would read, were one off.

With C the rotation from body axes to north, east and down that the attitude tells, all that relations compare are
functions of what stands here. So what an error does in a relation is the relation with the error less that without.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from gtmbench.engine.flight import Flight, trailing_means
from gtmbench.engine.relation import Effect
from gtmbench.engine.samples import Samples, edges_of, means_between, rough_between
from gtmbench.values.channels import ACCELEROMETERS, FT_S_PER_KT, G_M_S2, GPS_VELOCITY, M_PER_FT, MAGNETOMETER
from gtmbench.values.record import FloatArray

# by which readings become m, m/s and m/s2, forward, right and down; the field stays in its unit, vanes in deg
UNITS: Mapping[str, float] = {
    "nx": G_M_S2,
    "ny": G_M_S2,
    "nz": -G_M_S2,
    "tas": FT_S_PER_KT * M_PER_FT,
    "altitude": M_PER_FT,
}
WIND = ("wind_north", "wind_east")  # no sensors: what the air moves by, in m/s
_DELAYS_S = np.linspace(0.0, 0.5, 26)  # of a GPS
_USUAL_DELAY_S = 0.15  # of a GPS that doesn't tell its own
_FEWEST = 50  # blocks by which a delay is told
_SAMPLES = 5.0  # by which noise is told
OF_WHITE = 6.0  # the mean square second difference of white noise: 1 + 4 + 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Course:
    """A flight's course, block by block; NaN where nothing is read."""

    flight: Flight
    matrices: FloatArray = field(repr=False)  # shape (blocks, 3, 3): C
    # by channel, shape (blocks,): means over blocks, in m, m/s and m/s2 (accelerometers along forward, right and down),
    # vanes in deg; of a GPS as late as it is, put right
    read: Mapping[str, FloatArray] = field(repr=False)
    # by channel, shape (blocks,): the power of their noise from sample to sample, in the same units, over about a
    # second; of all that are read
    noise: Mapping[str, FloatArray] = field(default_factory=dict, repr=False)
    # by channel: the usual time between two of their samples
    steps_s: Mapping[str, float] = field(default_factory=dict, repr=False)

    def has(self, *channels: str) -> bool:
        """Tell whether channels are read at all."""
        return all(name in self.read for name in channels)

    def columns(self, channels: Sequence[str]) -> FloatArray:
        """Return channels side by side, shape (blocks, channels)."""
        return np.column_stack([self.read[name] for name in channels])

    def off_by(self, effect: Effect, share: float) -> Course:
        """Return the course with a share of an effect in it: on channels, and on the attitude."""
        read = dict(self.read)
        for name, wrong in (effect.channels or {}).items():
            if name in read:
                read[name] = read[name] + share * wrong
        matrices = self.matrices
        if effect.turned is not None:
            matrices = matrices + share * np.cross(np.radians(effect.turned)[:, :, np.newaxis], matrices, axis=1)
        return replace(self, read=read, matrices=matrices)

    @cached_property
    def pulled(self) -> FloatArray:
        """C f + g, the acceleration that forces make, in m/s2 north, east, down; shape (blocks, 3)."""
        felt = np.einsum("nij,nj->ni", self.matrices, self.columns(ACCELEROMETERS))
        return np.asarray(felt + np.array([0.0, 0.0, G_M_S2]))

    @cached_property
    def velocity(self) -> FloatArray:
        """The velocity over ground by the GPS, in m/s, shape (blocks, 3)."""
        return self.columns(GPS_VELOCITY)

    @cached_property
    def air_axes(self) -> FloatArray:
        """The axes of the air in north, east and down: along, across and normal to the way; shape (blocks, 3, 3)."""
        none = np.zeros(len(self.flight))
        alpha, beta = (np.radians(self.read.get(name, none)) for name in ("alpha", "beta"))
        ca, sa, cb, sb = np.cos(alpha), np.sin(alpha), np.cos(beta), np.sin(beta)
        to_body = np.array([[ca * cb, sb, sa * cb], [-ca * sb, cb, -sa * sb], [-sa, none, ca]])
        return np.asarray(np.einsum("nij,ajn->nai", self.matrices, to_body))

    @cached_property
    def through(self) -> FloatArray:
        """The velocity through the air, and the wind that is thought to be wrong, in m/s; shape (blocks, 3)."""
        own = self.air_axes[:, 0] * self.read["tas"][:, np.newaxis]
        return np.asarray(own + self.air_moves)

    @cached_property
    def air_moves(self) -> FloatArray:
        """By how much the air moves beside its constant wind, in m/s; shape (blocks, 3)."""
        none = np.zeros(len(self.flight))
        return np.column_stack([*(self.read.get(name, none) for name in WIND), none])

    @cached_property
    def field(self) -> FloatArray:
        """What the magnetometer reads, shape (blocks, 3)."""
        return self.columns(MAGNETOMETER)

    @cached_property
    def strength(self) -> float:
        """How strong the field is, in the magnetometer's unit."""
        return float(np.nanmedian(np.linalg.norm(self.field, axis=1)))

    def unit_of(self, channel: str) -> float:
        """Return what an error of one is in a channel's unit: of a magnetometer, a share of the field."""
        return self.strength if channel in MAGNETOMETER else 1.0 / UNITS.get(channel, 1.0)

    def rates(self, levels: FloatArray) -> FloatArray:
        """Return by how much levels change over a second that ends with each block, per second."""
        count, found = self.second, np.full(levels.shape, np.nan)
        found[count:] = (levels[count:] - levels[:-count]) / (count * self.flight.blocks.period_s)
        return found

    def over_second(self, values: FloatArray) -> FloatArray:
        """Return means of values over the same second, the half blocks at its ends counted by half."""
        count, found = self.second, np.full(values.shape, np.nan)
        sums = np.cumsum(np.nan_to_num(values), axis=0)
        ends = 0.5 * (np.nan_to_num(values[count:]) - np.nan_to_num(values[:-count]))
        found[count:] = (sums[count:] - sums[:-count] - ends) / count
        missing = np.cumsum(np.isnan(values), axis=0)
        before = np.concatenate([np.zeros((1, *values.shape[1:])), missing[: -count - 1]])
        found[count:][missing[count:] > before] = np.nan
        return found

    @property
    def second(self) -> int:
        """How many blocks a second has."""
        return max(round(1.0 / self.flight.blocks.period_s), 1)


def course_of(flight: Flight, sensors: Mapping[str, Samples]) -> Course:
    """Return the course of a flight by what its other sensors read.

    `sensors`, by channel: in the units of channels, on the flight's clock.
    """
    edges = edges_of(flight.blocks)
    whole = {
        name: each for name, each in sensors.items() if np.isfinite(each.values).sum() > 1 and name not in GPS_VELOCITY
    }
    read = {name: UNITS.get(name, 1.0) * means_between(each, edges) for name, each in whole.items()}
    none = np.zeros(len(flight))
    steps_s = {name: each.step_s for name, each in sensors.items()}
    noise = {name: _noise(flight, each, edges, UNITS.get(name, 1.0)) for name, each in sensors.items()}
    course = Course(
        flight=flight, matrices=flight.matrices, read=read | dict.fromkeys(WIND, none), noise=noise, steps_s=steps_s
    )
    if not {*GPS_VELOCITY} <= sensors.keys():
        return course
    return _with_gps(course, [sensors[name] for name in GPS_VELOCITY], edges)


def _noise(flight: Flight, samples: Samples, edges: FloatArray, unit: float) -> FloatArray:
    """Return the power of a sensor's noise: a sixth of its mean square second difference, were it white."""
    over = max(round(max(1.0, _SAMPLES * samples.step_s) / flight.blocks.period_s), 1)
    return unit**2 / OF_WHITE * trailing_means(rough_between(samples, edges), over)


def _with_gps(course: Course, velocity: Sequence[Samples], edges: FloatArray) -> Course:
    """Return a course with what a GPS reads, earlier by its delay: at which the accelerometers fit best."""

    def late(delay_s: float) -> Course:
        own = {
            name: means_between(Samples(each.time_s - delay_s, each.values), edges)
            for name, each in zip(GPS_VELOCITY, velocity, strict=True)
        }
        return replace(course, read={**course.read, **own})

    if not course.has(*ACCELEROMETERS):
        return late(_USUAL_DELAY_S)
    pulled = course.over_second(course.pulled)
    misfits = np.array([_misfit(late(float(delay_s)), pulled) for delay_s in _DELAYS_S])
    if not np.isfinite(misfits).all():
        return late(_USUAL_DELAY_S)
    return late(float(_DELAYS_S[int(np.argmin(misfits))]))


def _misfit(course: Course, pulled: FloatArray) -> float:
    """Return by how much velocity and force part within a second, as the median of squares.

    Within a second, and not at all: an accelerometer that is off, turned by the attitude, would be taken for a delay.
    """
    apart = course.rates(course.velocity) - pulled
    changes = apart[course.second :] - apart[: -course.second]
    changes = changes[np.isfinite(changes).all(axis=1)]
    return float(np.median(np.square(changes).sum(axis=1))) if len(changes) >= _FEWEST else float("nan")
