"""The equations of the aircraft's answer: which causes explain what, by which channels, and both sides of samples.

Every rotational acceleration, and every specific force, is linear in the flow, the body rates, the inertial products,
thrust and the deflections, by the dynamic pressure of the moment.

The thrust that a throttle makes.

An engine follows its throttle late and not in proportion. With L the lag 1/(tau s + 1), once or twice, thrust is taken
to be

    h = (u + b u^2 / 100) / (1 + 2 b u0 / 100),   u = L throttle,

in percent of throttle at u0, the usual one. tau and b are identified from the forward acceleration
(`identification.py`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from gtmbench.checks import number, whole
from gtmbench.detectors.tables import keys
from gtmbench.values.attitude_estimators import held
from gtmbench.values.channels import COMMANDS, FT_S_PER_KT, G_FT_S2, GYROS
from gtmbench.values.record import FloatArray

THROTTLE = "throttle"
STEP_PERCENT = 20.0  # of throttle, beside a degree of a surface: what is tolerated of either is alike
_MOST_LAG_S, _MOST_BEND = 60.0, 100.0  # beyond is a broken file: no engine is as slow, no thrust as bent


@dataclass(frozen=True, kw_only=True)
class Engine:
    """How thrust follows a throttle.

    >>> engine = Engine(lag_s=1.0, lags=2, bend=1.0, level=25.0)
    >>> (engine.thrust(np.array([26.0])) - engine.thrust(np.array([25.0]))).round(2)
    array([1.01])
    """

    lag_s: float  # tau
    lags: int = 1  # 1, or 2 in a row
    bend: float = 0.0  # b
    level: float = 0.0  # u0, in percent

    @property
    def slope(self) -> float:
        """Of thrust at the usual throttle, before it is made 1."""
        return 1.0 + 2.0 * self.bend * self.level / 100.0

    def thrust(self, lagged: FloatArray) -> FloatArray:
        """Return h of a throttle that is behind its lags, both in percent."""
        return np.asarray((lagged + self.bend * np.square(lagged) / 100.0) / self.slope)

    def table(self) -> dict[str, object]:
        """Return it as plain values."""
        return {"lag_s": self.lag_s, "lags": self.lags, "bend": self.bend, "level": self.level}


def engine_of(where: str, given: Any) -> Engine:
    """Return the engine of a table, every key checked. InputError naming the key, what stands there and what should."""
    table = keys(where, given, ("lag_s", "lags", "bend", "level"))
    return Engine(
        lag_s=number(f"{where}.lag_s", table["lag_s"], 0.0, _MOST_LAG_S, above=True),
        lags=whole(f"{where}.lags", table["lags"], 1, 2),
        bend=number(f"{where}.bend", table["bend"], -_MOST_BEND, _MOST_BEND),
        level=number(f"{where}.level", table["level"], -100.0, 100.0),
    )


_LAMBDA_RAD_S = 2.0  # of the filter behind which both sides stand, and rates as their derivatives
SLOW_S = 0.3  # what a slow servo is compared with: u less u behind such a lag
SLOW_ENGINE_S = 1.5  # and a slow engine
_AIR_LAG_S = 1.0  # of the dynamic pressure: an airspeed is noisy
_SCALE_HEIGHT_FT = 30_000.0  # of the air's density, near enough for a ratio
OWN_SURFACES = {
    "lateral": ("aileron", "rudder"),
    "longitudinal": ("elevator", THROTTLE),
    "forward": ("elevator", THROTTLE),
}
_AXES = {"p": "lateral", "q": "longitudinal", "r": "lateral"}
_FORWARD = {"nx": "forward"}
_RATES = np.pi / 180.0  # makes a product of two rates in deg/s one in deg/s2
KT_S_PER_G = G_FT_S2 / FT_S_PER_KT


@dataclass(frozen=True, kw_only=True)
class Flow:
    """The channels by which the flow is known."""

    vanes: bool = True  # whether alpha and beta are read; else the accelerometers stand for them
    airspeed: bool = True  # whether the airspeed is; else one dynamic pressure is taken for all
    # whether nx and the attitude are, beside vanes and airspeed, so that the throttle can be judged
    forward: bool = False

    @property
    def channels(self) -> tuple[str, ...]:
        """What is read beside gyros and commands."""
        air = ("tas", "altitude") if self.airspeed else ()
        along = ("nx", "phi", "theta") if self.forward else ()
        return (*(("alpha", "beta") if self.vanes else ()), "ny", "nz", *air, *along)

    def equations(self, surfaces: Sequence[str]) -> dict[str, str]:
        """Return, by the channel that is explained, which causes explain it."""
        accelerometers = {"ny": "lateral", "nz": "longitudinal"} if self.vanes else {}
        return _AXES | accelerometers | (_FORWARD if THROTTLE in surfaces else {})


def causes_beside(axis: str, surfaces: Sequence[str]) -> int:
    """Return how many causes beside the surfaces stand in an equation; thrust is one where the throttle is none."""
    return {"lateral": 11, "longitudinal": 8 + (THROTTLE not in surfaces), "forward": 6}[axis]


FULL = Flow(forward=True)


@dataclass(frozen=True, kw_only=True)
class Frame:
    """What the equations are written in."""

    flow: Flow
    surfaces: tuple[str, ...]  # those that moved in the healthy flights, so that their effect is known
    servo_s: float  # the servos' lag
    engine: Engine
    reference: float  # the airspeed in kt at which Q is 1

    @property
    def equations(self) -> dict[str, str]:
        """By the channel that is explained, which causes explain it."""
        return self.flow.equations(self.surfaces)

    @property
    def steps(self) -> FloatArray:
        """The unit of each surface: a degree, or some percent of the throttle."""
        return np.array([STEP_PERCENT if name == THROTTLE else 1.0 for name in self.surfaces])


def speeding(read: Mapping[str, FloatArray]) -> FloatArray:
    """Return how fast the airspeed grows in still air, in kt/s, by accelerometers and vanes, whatever engines do.

    >>> level = dict.fromkeys(("alpha", "beta", "phi", "theta", "ny"), np.zeros(1))
    >>> speeding(level | {"nx": np.array([0.1]), "nz": np.ones(1)}).round(2)  # forward by a tenth of g
    array([1.91])
    """
    alpha, beta, phi, theta = (np.radians(read[name]) for name in ("alpha", "beta", "phi", "theta"))
    forward = (read["nx"] - np.sin(theta)) * np.cos(alpha)
    down = (np.cos(phi) * np.cos(theta) - read["nz"]) * np.sin(alpha)
    right = (read["ny"] + np.sin(phi) * np.cos(theta)) * np.sin(beta)
    return np.asarray(KT_S_PER_G * ((forward + down) * np.cos(beta) + right))


class _Regressed(NamedTuple):
    explained: dict[str, FloatArray]
    regressors: dict[str, FloatArray]
    commanded: FloatArray
    slew: FloatArray
    pressure: FloatArray


class Sides(NamedTuple):
    """Both sides of the equations as they are: what is explained, causes by axis, and what they are made of."""

    explained: dict[str, FloatArray]
    causes: dict[str, FloatArray]
    driven: FloatArray
    pressure: FloatArray


class Regressing:
    """The equations' both sides, as samples come in."""

    def __init__(self, frame: Frame, period_s: float) -> None:
        self._frame = frame
        self._columns = {name: i for i, name in enumerate((*GYROS, *frame.flow.channels, *COMMANDS))}
        self._moving = [name for name in frame.surfaces if name != THROTTLE]
        self._servos = _Lags([np.exp(-period_s / frame.servo_s)])
        self._engine = [_Lags([np.exp(-period_s / frame.engine.lag_s)]) for _ in range(frame.engine.lags)]
        self._air = _Lags([np.exp(-period_s / _AIR_LAG_S)])
        self._smooth = _Lags([np.exp(-period_s * _LAMBDA_RAD_S)])
        slow_s = [SLOW_ENGINE_S if name == THROTTLE else SLOW_S for name in frame.surfaces]
        self._slow = _Lags(
            [np.exp(-period_s / each) for each in slow_s] if len(set(slow_s)) > 1 else [np.exp(-period_s / slow_s[0])]
        )
        self._held = np.zeros((1, len(self._columns)))  # the row before, and 0 before the first

    def sides(self, values: FloatArray) -> Sides:
        """Return both sides of the equations for the next rows, as they are."""
        joined = held(np.concatenate([self._held, values]))
        self._held, values = joined[-1:], joined[1:]
        read = {name: values[:, column] for name, column in self._columns.items()}
        pressure = self._air.push(self._pressure(read)[:, np.newaxis])[:, 0]
        driven = self._servos.push(np.column_stack([read[name] for name in self._moving]))
        thrust = read[THROTTLE][:, np.newaxis]
        for lag in self._engine:
            thrust = lag.push(thrust)
        thrust = self._frame.engine.thrust(thrust[:, 0])
        if THROTTLE in self._frame.surfaces:
            thrust = thrust / STEP_PERCENT
            driven = np.column_stack([driven, thrust])
        return Sides(
            explained={name: read[name] for name in self._frame.equations},
            causes=self._causes(read, pressure, driven, thrust),
            driven=driven,
            pressure=pressure,
        )

    def push(self, values: FloatArray) -> _Regressed:
        """Return both sides of the equations for the next rows, behind the lag."""
        made = self.sides(values)
        causes, sides = made.causes, list(made.explained.values())
        joined = np.column_stack([*sides, made.driven, made.pressure, *causes.values()])
        smooth = self._smooth.push(joined)
        after = len(sides) + len(self._frame.surfaces)
        explained = {
            name: _LAMBDA_RAD_S * (side - smooth[:, i]) if name in GYROS else smooth[:, i]
            for i, (name, side) in enumerate(made.explained.items())
        }
        by_axis, first = {}, after + 1
        for axis, of_axis in causes.items():
            by_axis[axis] = smooth[:, first : first + of_axis.shape[1]]
            first += of_axis.shape[1]
        commanded = smooth[:, len(sides) : after]
        return _Regressed(
            explained=explained,
            regressors={name: by_axis[axis] for name, axis in self._frame.equations.items()},
            commanded=commanded,
            slew=(commanded - self._slow.push(commanded)) / SLOW_S,
            pressure=np.maximum(smooth[:, after], 1e-3),
        )

    def _pressure(self, read: Mapping[str, FloatArray]) -> FloatArray:
        """Return the dynamic pressure over the reference's."""
        if not self._frame.flow.airspeed:
            return np.ones(len(read["p"]))
        speed = read["tas"] / self._frame.reference
        return np.asarray(speed * np.abs(speed) * np.exp(-read["altitude"] / _SCALE_HEIGHT_FT))

    def _causes(
        self, read: Mapping[str, FloatArray], q: FloatArray, driven: FloatArray, thrust: FloatArray
    ) -> dict[str, FloatArray]:
        """Return what lateral and longitudinal motion are linear in: the surfaces first."""
        p, r, pitch = read["p"], read["r"], read["q"]
        damping = np.sqrt(np.maximum(q, 0.0))
        ones = np.ones(len(q))
        if self._frame.flow.vanes:
            alpha, beta = read["alpha"], read["beta"]
            lift, side, lifts = q * alpha, q * beta, q * alpha**2
            slip = beta
        else:  # the specific force is the flow's, by the dynamic pressure
            lift, side = read["nz"], read["ny"]
            dense = np.maximum(q, 1e-3)
            lifts, alpha, slip = lift**2 / dense, lift / dense, side / dense
        # moments over inertia by the air, q its dynamic pressure: surfaces as q delta; then flow as q alpha and q beta
        # with what bends them, damping as sqrt(q) times rates; the products of rates are Euler's, and a constant is a
        # sensor's bias
        by_air = [driven[:, i] * q for i in range(len(self._moving))]
        judged = THROTTLE in self._frame.surfaces
        pushed = [thrust] if judged else []
        lateral = [
            side,
            np.abs(slip) * side,
            alpha * side,
            damping * p,
            damping * r,
            damping * alpha * p,
            damping * alpha * r,
        ]
        lateral += [q, pitch * r * _RATES, p * pitch * _RATES, ones]
        longitudinal = [lift, lifts, slip * side, damping * pitch, q]
        forward = [*longitudinal, ones]
        longitudinal += [] if judged else [thrust]
        longitudinal += [p * r * _RATES, (p**2 - r**2) * _RATES, ones]
        by_axis = {"lateral": lateral, "longitudinal": longitudinal}
        if judged:
            by_axis["forward"] = forward
        return {axis: np.column_stack([*by_air, *pushed, *causes]) for axis, causes in by_axis.items()}


class _Lags:
    """First-order lags of unit gain, a pole a column or one for all, at rest in the first row."""

    def __init__(self, poles: Sequence[float]) -> None:
        self._poles = [float(pole) for pole in poles]
        self._rest: FloatArray | None = None
        self._carried: list[FloatArray] = []

    def push(self, values: FloatArray) -> FloatArray:
        from scipy.signal import lfilter

        if self._rest is None and len(values):
            self._rest = values[0].copy()
            self._carried = [np.zeros((1, values.shape[1] if len(self._poles) == 1 else 1)) for _ in self._poles]
        if self._rest is None:
            return values
        moved = np.empty_like(values)
        wide = len(self._poles) == 1
        for i, pole in enumerate(self._poles):
            part = slice(None) if wide else slice(i, i + 1)
            moved[:, part], self._carried[i] = lfilter(
                [1.0 - pole], [1.0, -pole], values[:, part] - self._rest[part], axis=0, zi=self._carried[i]
            )
        return np.asarray(moved + self._rest)
