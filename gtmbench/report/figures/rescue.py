"""A flight in space, how an aircraft is drawn there, and the picture of a rescue: both ways, and the broken sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.bench.loop_flight import DEPARTURE, ENVELOPE
from gtmbench.detectors.accommodation.without_sensor import REPLACED, SUSPECTED
from gtmbench.report.figures.panels import as_it_is
from gtmbench.report.words.judgement import fault_text
from gtmbench.report.words.units import with_unit
from gtmbench.study.run import Rescue
from gtmbench.values.channels import ATTITUDE, unit_of
from gtmbench.values.record import FloatArray, Record, Span

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

_SIDES = 10  # of what is round
# forward, radius
_NOSE_TO_TAIL = ((0.50, 0.0), (0.47, 0.025), (0.40, 0.05), (0.30, 0.058), (-0.15, 0.058), (-0.40, 0.03), (-0.55, 0.008))
_ENGINE = ((0.13, 0.026), (0.10, 0.032), (0.0, 0.028), (-0.03, 0.018))  # forward, radius
# leading and trailing edge at the root, then at the tip: forward, right, down
_WING = ((0.14, 0.04, 0.025), (-0.10, 0.04, 0.025), (-0.19, 0.52, -0.02), (-0.12, 0.52, -0.02))
_TAIL = ((-0.40, 0.02, -0.02), (-0.53, 0.02, -0.02), (-0.57, 0.19, -0.035), (-0.52, 0.19, -0.035))  # as the wing's
_FIN = ((-0.34, 0.0, -0.03), (-0.52, 0.0, -0.03), (-0.58, 0.0, -0.22), (-0.51, 0.0, -0.22))  # as the wing's


def _turned(stations: Sequence[tuple[float, float]], right: float = 0.0, down: float = 0.0) -> FloatArray:
    """Return the triangles of a body of revolution about an axis that points forward."""
    angles = 2.0 * np.pi * np.arange(_SIDES + 1) / _SIDES
    rings = [
        np.column_stack([np.full(_SIDES + 1, x), right + radius * np.cos(angles), down + radius * np.sin(angles)])
        for x, radius in stations
    ]
    return np.concatenate(
        [_strip(ring[i : i + 2], other[i : i + 2]) for ring, other in pairwise(rings) for i in range(_SIDES)]
    )


def _strip(one: FloatArray, other: FloatArray) -> FloatArray:
    return np.array([[one[0], one[1], other[0]], [one[1], other[1], other[0]]])


def _flat(*corners: tuple[float, float, float]) -> FloatArray:
    """Return the triangles of a surface with four corners."""
    a, b, c, d = np.array(corners)
    return np.array([[a, b, c], [a, c, d]])


def _both_sides(triangles: FloatArray) -> FloatArray:
    return np.concatenate([triangles, triangles * [1.0, -1.0, 1.0]])


# a twin-engined airliner in body axes (forward, right, down), about 1 long and wide: triangles, shape (n, 3, 3), a part
AIRCRAFT = {
    "fuselage": np.concatenate([_turned(_NOSE_TO_TAIL), _both_sides(_turned(_ENGINE, right=0.17, down=0.05))]),
    "wing": _both_sides(_flat(*_WING)),
    "fin": np.concatenate([_flat(*_FIN), _both_sides(_flat(*_TAIL))]),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """A flight to be seen in space."""

    flight: Record
    name: str = ""  # what it is called among others; empty where it is the only one
    # of the way flown, and of the wing where there are several
    tint: str = "#78a0dc"
    moments: Sequence[tuple[float, str]] = ()  # times that are marked on its way, and what happened then

    @property
    def place_ft(self) -> FloatArray:
        """Where it is, north, east and down of where it began, shape (samples, 3)."""
        flight = self.flight
        from_start = [flight[name] - flight[name][0] for name in ("north", "east")]
        return np.column_stack([*from_start, flight["altitude"][0] - flight["altitude"]])

    @property
    def quaternions(self) -> FloatArray:
        """Body-to-world rotations as x, y, z, w: yaw, then pitch, then roll; shape (samples, 4)."""
        return self.turned(slice(None))

    def turned(self, rows: slice) -> FloatArray:
        """Return `quaternions` of some samples."""
        from scipy.spatial.transform import Rotation

        angles = self.flight.matrix(["psi", "theta", "phi"])[rows]
        return np.asarray(Rotation.from_euler("ZYX", angles, degrees=True).as_quat())

    def row(self, time_s: float) -> int:
        """Return the sample at a time."""
        return round((time_s - self.flight.start_s) / self.flight.sample_period_s)


TINTS = {"unaided": "#d62728", "rescued": "#1f77b4"}
_BEFORE_S = 5.0  # the onset: where what is shown begins

Moment = tuple[float, str]  # a time in seconds, and what happened then


def shown_s(rescue: Rescue) -> Span:
    """Return the span that is shown: from just before the onset on."""
    return max(rescue.onset_s - _BEFORE_S, 0.0), rescue.rescued.truth.end_s


def shown_flight(rescue: Rescue, name: str) -> Record:
    """Return the truth of one of the flights, over that span, as far as it was flown."""
    (start_s, end_s), truth = shown_s(rescue), rescue.flights[name].truth
    return truth.between(start_s, min(end_s, truth.end_s))


def moments(rescue: Rescue) -> dict[str, list[Moment]]:
    """Return of either flight when, after the onset, the broken sensor was told, and how it ends: what is marked."""
    broken, since = {fault.channel for fault in rescue.faults}, rescue.onset_s
    words = {SUSPECTED: "alarm: {} is suspected", REPLACED: "{} is flown without", DEPARTURE: "departure"}
    told: dict[str, list[Moment]] = {name: [] for name in rescue.flights}
    for name, flight in rescue.flights.items():
        seen = set()
        for event in flight.events:
            is_told = event.kind in (DEPARTURE, ENVELOPE) or (event.channel in broken and event.kind in words)
            if is_told and event.kind not in seen:
                seen.add(event.kind)
                text = words.get(event.kind, "end of the model's range").format(event.channel)
                told[name].append((event.time_s, f"{text}, {event.time_s - since:.2f} s"))
    told["unaided"].insert(0, (since, "; ".join(fault_text(fault) for fault in rescue.faults)))
    return told


_APART_S = 2.5  # between two aircraft on a way
_SHARE = 0.14  # of the greatest extent: an aircraft's length
_DARK, _LIGHT = "#3c4650", "#aab4be"
_HALF_TURN_DEG = 180.0  # by definition
_LINES = {"unaided": -1.0, "rescued": 1.0}  # whether moments are told below the way or above


def rescue_figure(rescue: Rescue) -> Figure:
    """Draw both flights from just before the onset on; the ways along and across the heading at its beginning."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 5.6))
    grid = figure.add_gridspec(3, 2, width_ratios=[2.1, 1.0], left=0.0, right=0.985, top=0.91, bottom=0.09, hspace=0.16)
    space: Axes3D = figure.add_subplot(grid[:, 0], projection="3d")
    _draw_space(space, rescue)
    channel = rescue.faults[0].channel
    for row, name in enumerate(dict.fromkeys((channel, "phi", "altitude"))):
        _draw_channel(figure.add_subplot(grid[row, 1]), rescue, name, is_last=row == len({channel, "phi"}))
    broken = "; ".join(as_it_is(fault_text(fault)) for fault in rescue.faults)
    figure.suptitle(f"The same flight twice, with the same fault: {broken}", x=0.5)
    return figure


def _draw_space(space: Axes3D, rescue: Rescue) -> None:
    told = moments(rescue)
    scenes = {
        name: Scene(flight=shown_flight(rescue, name), tint=TINTS[name], moments=told[name]) for name in rescue.flights
    }
    heading_deg = float(scenes["rescued"].flight["psi"][0])
    ways = {name: _drawn(scene.place_ft, heading_deg) for name, scene in scenes.items()}
    corners = np.concatenate(list(ways.values()))
    low, high = corners.min(axis=0), corners.max(axis=0)
    length = _SHARE * float((high - low).max())
    for name, scene in scenes.items():
        space.plot(*ways[name].T, color=scene.tint, lw=1.6)
        _draw_aircraft(space, scene, heading_deg, length)
        x, y, z = ways[name][-1]
        space.text(x, y, z - 0.5 * length, name, color=scene.tint, ha="center", va="top", fontsize=12, weight="bold")
        _draw_moments(space, scene, ways[name], _LINES[name] * length)
    low, high = low - 0.7 * length, high + 0.7 * length
    space.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    space.set_box_aspect(high - low, zoom=1.3)
    space.set_xlabel("along the heading (ft)", labelpad=10.0)
    space.set_yticks([])
    space.set_zlabel("height (ft)", labelpad=6.0)
    space.view_init(elev=24.0, azim=-64.0)
    space.computed_zorder = False  # as drawn: words and moments in front


def _drawn(place_ft: FloatArray, heading_deg: float) -> FloatArray:
    """Return north, east, down as the axes have them: along a heading, to its left, up."""
    cosine, sine = np.cos(np.deg2rad(heading_deg)), np.sin(np.deg2rad(heading_deg))
    turn = np.array([[cosine, sine, 0.0], [sine, -cosine, 0.0], [0.0, 0.0, -1.0]])
    return np.asarray(place_ft @ turn)


def _draw_aircraft(space: Axes3D, scene: Scene, heading_deg: float, length: float) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection
    from scipy.spatial.transform import Rotation

    flight, place_ft = scene.flight, scene.place_ft
    every = round(_APART_S / flight.sample_period_s)
    rows = np.arange(every // 2, len(flight), every)
    turns = Rotation.from_quat(scene.quaternions[rows])
    for i, row in enumerate(rows):
        for part, tint in zip(AIRCRAFT.values(), (_LIGHT, scene.tint, _DARK), strict=True):
            corners = turns[i].apply(length * part.reshape(-1, 3)) + place_ft[row]
            triangles = list(_drawn(corners, heading_deg).reshape(part.shape))
            space.add_collection3d(Poly3DCollection(triangles, facecolors=tint, edgecolors=tint, linewidths=0.2))


def _draw_moments(space: Axes3D, scene: Scene, way: FloatArray, beyond_ft: float) -> None:
    """Draw points on the way, and beyond the first what happened at them, in time."""
    if not scene.moments:
        return
    rows = [scene.row(time_s) for time_s, _ in scene.moments]
    space.scatter(*way[rows].T, color=scene.tint, edgecolor="white", s=36, depthshade=False, zorder=10)
    x, y, z = way[rows[0]]
    space.plot([x, x], [y, y], [z, z + beyond_ft], color=scene.tint, lw=0.8)
    words = "\n".join(as_it_is(text) for _, text in scene.moments)
    where = {"va": "bottom" if beyond_ft > 0.0 else "top", "ha": "left" if beyond_ft > 0.0 else "right"}
    space.text(x, y, z + beyond_ft, words, color=scene.tint, fontsize=9, **where)


def _parted(angle_deg: FloatArray) -> FloatArray:
    """Return an angle with no value where it goes round, so that no line is drawn from 180 to -180 deg."""
    goes_round = np.abs(np.diff(angle_deg, prepend=angle_deg[0])) > _HALF_TURN_DEG
    return np.where(goes_round, np.nan, angle_deg)


def _draw_channel(axis: Axes, rescue: Rescue, name: str, *, is_last: bool) -> None:
    for which in rescue.flights:
        flight = shown_flight(rescue, which)
        values = _parted(flight[name]) if name in ATTITUDE else flight[name]
        axis.plot(flight.time_s - rescue.onset_s, values, color=TINTS[which], lw=1.2)
    for time_s, _ in moments(rescue)["rescued"]:
        axis.axvline(time_s - rescue.onset_s, color=TINTS["rescued"], lw=0.8, ls=":")
    axis.set_ylabel(with_unit(name, unit_of(name)))
    axis.grid(alpha=0.3)
    if is_last:
        axis.set_xlabel("s after the fault began; dotted: alarm and name")
    else:
        axis.tick_params(labelbottom=False)
