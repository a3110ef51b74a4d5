"""The aircraft's answer to its commands, identified from healthy flight: how far off each surface seems to be.

Without a model of the aircraft, every rotational acceleration is taken to be linear in what causes it: the flow, the
body rates, the inertial products and the deflections, all by the dynamic pressure of the moment (V. Klein and E. A.
Morelli, Aircraft System Identification, AIAA 2006, chapter 5). With q' = d/dt q and F the lag lambda/(s + lambda),
which makes a derivative measurable,

    F q' = F (X theta) + e,   F q' = lambda (q - F q),

theta by least squares in coloured noise (`identification.py`). A surface that is off by d degrees adds F (Q d) times
its own column of theta to every equation at once, Q being the dynamic pressure. So the residuals e, weighed by their
covariance S on healthy flight, say by how many degrees each surface seems to be off,

    d = (G' S^-1 G)^-1 G' S^-1 e / Q,

and what no surface explains is left: z, of deviation 1 on healthy flight, to tell that something else happened.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from gtmbench.checks import number, shown
from gtmbench.detectors.tables import array_of, keys, names_of, table_of
from gtmbench.errors import InputError
from gtmbench.values.channels import COMMANDS, GYROS, SURFACES
from gtmbench.values.record import FloatArray

_LAMBDA_RAD_S = 2.0
_SLOW_S = 0.3  # what a slow servo is compared with: u less u behind such a lag
_AIR_LAG_S = 1.0  # of the dynamic pressure: an airspeed is noisy
_SCALE_HEIGHT_FT = 30_000.0  # of the air's density, near enough for a ratio
_ENGINE = "throttle"  # a cause, and never judged: its effect is far from linear, and no equation is its own
OWN_SURFACES = {"lateral": ("aileron", "rudder"), "longitudinal": ("elevator",)}
CAUSES = {"lateral": 11, "longitudinal": 9}  # beside the surfaces
_AXES = {"p": "lateral", "q": "longitudinal", "r": "lateral"}
_RATES = np.pi / 180.0  # makes a product of two rates in deg/s one in deg/s2


class Deviations(NamedTuple):
    """What is made of a stretch of samples; a row a sample.

    Attributes
    ----------
    off : shape (samples, surfaces)
        By how much each surface seems to be off, in its unit.
    commanded, slew : shape (samples, surfaces)
        What was commanded, behind servo and lag, and how fast that changes, in its unit and per second: as a servo
        that is slow by some tenths of a second sees it.
    left : shape (samples, any)
        What no surface explains, in deviations on healthy flight.
    """

    off: FloatArray
    commanded: FloatArray
    slew: FloatArray
    left: FloatArray


@dataclass(frozen=True, kw_only=True)
class Flow:
    """The channels by which the flow is known.

    Attributes
    ----------
    vanes : bool
        Whether alpha and beta are read; else the accelerometers stand for them.
    airspeed : bool
        Whether the airspeed is; else one dynamic pressure is taken for all.
    """

    vanes: bool = True
    airspeed: bool = True

    @property
    def channels(self) -> tuple[str, ...]:
        """What is read beside gyros and commands."""
        air = ("tas", "altitude") if self.airspeed else ()
        return (*(("alpha", "beta") if self.vanes else ()), "ny", "nz", *air)

    @property
    def sensors(self) -> tuple[str, ...]:
        """Those whose fault could look like a surface's, and leave something beside it."""
        return ("alpha", "beta", "ny", "nz") if self.vanes else ()

    @property
    def equations(self) -> dict[str, str]:
        """By the channel that is explained, whether its motion is lateral or longitudinal."""
        return _AXES | ({"ny": "lateral", "nz": "longitudinal"} if self.vanes else {})


FULL = Flow()


@dataclass(frozen=True, kw_only=True, eq=False)
class Answer:
    """What was identified.

    Attributes
    ----------
    flow : Flow
    surfaces : tuple of str
        Those that moved in the healthy flights, so that their effect is known.
    lags_s : tuple of float
        Of servos and of engines.
    theta : mapping of equation to array
        Effects: first those of the surfaces, in the order of `surfaces`, 0 where there is none.
    covariance : shape (equations, equations)
        S, of what the equations leave on healthy flight.
    reference : float
        The airspeed in kt at which Q is 1.
    """

    flow: Flow
    surfaces: tuple[str, ...]
    lags_s: tuple[float, float]
    theta: Mapping[str, FloatArray]
    covariance: FloatArray
    reference: float

    @property
    def effects(self) -> FloatArray:
        """G: the effect of a degree of each surface on every equation, shape (equations, surfaces)."""
        return np.array([self.theta[name][: len(self.surfaces)] for name in self.flow.equations])

    def effect(self, equation: str, vane: str) -> float:
        """Return what a degree of a vane changes of an equation, where the dynamic pressure is 1."""
        explains = {"alpha": "longitudinal", "beta": "lateral"}[vane] == self.flow.equations[equation]
        return float(self.theta[equation][len(self.surfaces)]) if explains else 0.0  # the first cause beside surfaces

    @property
    def series(self) -> tuple[str, ...]:
        """The names of what is judged: the surfaces, and what none of them explains."""
        left = len(self.flow.equations) - len(self.surfaces)
        return (*self.surfaces, *(f"left {i + 1}" for i in range(left)))

    def start(self, sample_period_s: float) -> Answering:
        """Return what makes deviations of samples as they come in."""
        return Answering(self, sample_period_s)

    def table(self) -> dict[str, Any]:
        """Return it as plain values."""
        return {
            "vanes": self.flow.vanes,
            "airspeed": self.flow.airspeed,
            "surfaces": list(self.surfaces),
            "lags_s": list(self.lags_s),
            "theta": {name: values.tolist() for name, values in self.theta.items()},
            "covariance": self.covariance.tolist(),
            "reference": self.reference,
        }


class Answering:
    """An answer at work; its filters begin at rest in the first sample, and a missing sample holds the last one."""

    def __init__(self, answer: Answer, sample_period_s: float) -> None:
        self._answer = answer
        self._regressing = Regressing(answer.flow, answer.surfaces, answer.lags_s, answer.reference, sample_period_s)
        self._off, self._left = solved(answer)

    def push(self, values: FloatArray) -> Deviations:
        """Return the deviations of the next rows, of the channels in their order."""
        made = self._regressing.push(values)
        residuals = np.column_stack(
            [made.explained[name] - made.regressors[name] @ theta for name, theta in self._answer.theta.items()]
        )
        off = (residuals @ self._off.T) / made.pressure[:, np.newaxis]
        return Deviations(off=off, commanded=made.commanded, slew=made.slew, left=residuals @ self._left.T)


def solved(answer: Answer) -> tuple[FloatArray, FloatArray]:
    """Return what makes deviations, and what is left, of the equations' residuals."""
    root = np.linalg.cholesky(answer.covariance)
    white = np.linalg.solve(root, answer.effects)
    whole, _ = np.linalg.qr(white, mode="complete")
    inverse = np.linalg.inv(root)
    return np.linalg.pinv(white) @ inverse, whole[:, len(answer.surfaces) :].T @ inverse


class _Regressed(NamedTuple):
    explained: dict[str, FloatArray]
    regressors: dict[str, FloatArray]
    commanded: FloatArray
    slew: FloatArray
    pressure: FloatArray


class _Sides(NamedTuple):
    explained: dict[str, FloatArray]
    causes: dict[str, FloatArray]
    driven: FloatArray
    pressure: FloatArray


class Regressing:
    """The equations' both sides, as samples come in."""

    def __init__(
        self, flow: Flow, surfaces: Sequence[str], lags_s: Sequence[float], reference: float, period_s: float
    ) -> None:
        self._flow, self._surfaces, self._reference = flow, surfaces, reference
        self._columns = {name: i for i, name in enumerate((*GYROS, *flow.channels, *COMMANDS))}
        servo, engine = lags_s
        self._servos = _Lags([np.exp(-period_s / servo)])
        self._engine = _Lags([np.exp(-period_s / engine)])
        self._air = _Lags([np.exp(-period_s / _AIR_LAG_S)])
        self._smooth = _Lags([np.exp(-period_s * _LAMBDA_RAD_S)])
        self._slow = _Lags([np.exp(-period_s / _SLOW_S)])
        self._held: FloatArray | None = None

    def sides(self, values: FloatArray) -> _Sides:
        """Return both sides of the equations for the next rows, as they are."""
        values = self._without_holes(values)
        read = {name: values[:, column] for name, column in self._columns.items()}
        pressure = self._air.push(self._pressure(read)[:, np.newaxis])[:, 0]
        driven = self._servos.push(np.column_stack([read[name] for name in self._surfaces]))
        thrust = self._engine.push(read[_ENGINE][:, np.newaxis])[:, 0]
        return _Sides(
            explained={name: read[name] for name in self._flow.equations},
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
        after = len(sides) + len(self._surfaces)
        explained = {
            name: _LAMBDA_RAD_S * (side - smooth[:, i]) if name in GYROS else smooth[:, i]
            for i, (name, side) in enumerate(zip(self._flow.equations, sides, strict=True))
        }
        by_axis, first = {}, after + 1
        for axis, of_axis in causes.items():
            by_axis[axis] = smooth[:, first : first + of_axis.shape[1]]
            first += of_axis.shape[1]
        commanded = smooth[:, len(sides) : after]
        return _Regressed(
            explained=explained,
            regressors={name: by_axis[axis] for name, axis in self._flow.equations.items()},
            commanded=commanded,
            slew=(commanded - self._slow.push(commanded)) / _SLOW_S,
            pressure=np.maximum(smooth[:, after], 1e-3),
        )

    def _without_holes(self, values: FloatArray) -> FloatArray:
        """Return rows in which a missing value is the last one that was there."""
        before = np.zeros((1, values.shape[1])) if self._held is None else self._held[np.newaxis]
        joined = np.concatenate([before, values])
        rows = np.where(np.isfinite(joined), np.arange(len(joined))[:, np.newaxis], 0)
        filled = np.take_along_axis(joined, np.maximum.accumulate(rows, axis=0), axis=0)
        self._held = filled[-1]
        return np.asarray(filled[1:])

    def _pressure(self, read: Mapping[str, FloatArray]) -> FloatArray:
        """Return the dynamic pressure over the reference's."""
        if not self._flow.airspeed:
            return np.ones(len(read["p"]))
        speed = read["tas"] / self._reference
        return np.asarray(speed * np.abs(speed) * np.exp(-read["altitude"] / _SCALE_HEIGHT_FT))

    def _causes(
        self, read: Mapping[str, FloatArray], q: FloatArray, driven: FloatArray, thrust: FloatArray
    ) -> dict[str, FloatArray]:
        """Return what lateral and longitudinal motion are linear in: the surfaces first."""
        p, r, pitch = read["p"], read["r"], read["q"]
        damping = np.sqrt(np.maximum(q, 0.0))
        ones = np.ones(len(q))
        if self._flow.vanes:
            alpha, beta = read["alpha"], read["beta"]
            lift, side, lifts = q * alpha, q * beta, q * alpha**2
            slip = beta
        else:  # the specific force is the flow's, by the dynamic pressure
            lift, side = read["nz"], read["ny"]
            dense = np.maximum(q, 1e-3)
            lifts, alpha, slip = lift**2 / dense, lift / dense, side / dense
        by_air = [driven[:, i] * q for i in range(len(self._surfaces))]
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
        longitudinal = [
            lift,
            lifts,
            slip * side,
            damping * pitch,
            q,
            thrust,
            p * r * _RATES,
            (p**2 - r**2) * _RATES,
            ones,
        ]
        return {
            "lateral": np.column_stack([*by_air, *lateral]),
            "longitudinal": np.column_stack([*by_air, *longitudinal]),
        }


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


def answer_of(where: str, given: Any) -> Answer:
    """Return the answer of a table, every key checked.

    Raises
    ------
    InputError
        Naming the key, what stands there and what should.
    """
    names = ("vanes", "airspeed", "surfaces", "lags_s", "theta", "covariance", "reference")
    table = keys(where, given, names)
    for key in ("vanes", "airspeed"):
        if not isinstance(table[key], bool):
            raise InputError(f"{where}.{key} is {shown(table[key])}; it must be true or false")
    flow = Flow(vanes=table["vanes"], airspeed=table["airspeed"])
    surfaces = names_of(f"{where}.surfaces", table["surfaces"])
    if not surfaces or not set(surfaces) <= set(SURFACES):
        raise InputError(f"{where}.surfaces is {shown(table['surfaces'])}; it may hold {', '.join(SURFACES)}")
    theta = table_of(f"{where}.theta", table["theta"])
    equations = len(flow.equations)
    if list(theta) != list(flow.equations):
        raise InputError(f"{where}.theta holds {', '.join(theta)}; it must hold {', '.join(flow.equations)}")
    lengths = {name: len(surfaces) + CAUSES[axis] for name, axis in flow.equations.items()}
    lags_s = array_of(f"{where}.lags_s", table["lags_s"], (2,))
    answer = Answer(
        flow=flow,
        surfaces=surfaces,
        lags_s=(float(lags_s[0]), float(lags_s[1])),
        theta={name: array_of(f"{where}.theta.{name}", theta[name], (length,)) for name, length in lengths.items()},
        covariance=array_of(f"{where}.covariance", table["covariance"], (equations, equations)),
        reference=number(f"{where}.reference", table["reference"], 0.0, above=True),
    )
    try:
        np.linalg.cholesky(answer.covariance)
    except np.linalg.LinAlgError:
        raise InputError(f"{where}.covariance is no covariance; calibrate anew") from None
    if min(answer.lags_s) <= 0.0:
        raise InputError(f"{where}.lags_s is {shown(table['lags_s'])}; it must hold two times above 0")
    return answer
