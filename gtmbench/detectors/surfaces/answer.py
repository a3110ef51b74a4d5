"""The aircraft's answer to its commands, identified from healthy flight: how far off each surface seems to be.

Without a model of the aircraft, every rotational acceleration is taken to be linear in what causes it: the flow, the
body rates, the inertial products and the deflections, all by the dynamic pressure of the moment (V. Klein and E. A.
Morelli, Aircraft System Identification, AIAA 2006, chapter 5). With q' = d/dt q and F the lag lambda/(s + lambda),
which makes a derivative measurable,

    F q' = F (X theta) + e,   F q' = lambda (q - F q),

theta by least squares in coloured noise (`identification.py`). A surface that is off by d degrees adds F (Q d) times
its own column of theta to every equation at once, Q being the dynamic pressure. So the residuals e, weighed by their
covariance S on healthy flight, say by how many degrees each surface seems to be off,

    d = (G' S^-1 G)^-1 G' S^-1 e / Q.

Where the forward acceleration is read, too, the throttle is one of them (`equations.py`): thrust is a cause of q', nz
and nx, in steps of 20 % and whatever the dynamic pressure is. S holds no covariance of nx with another equation, so
that nx changes nothing of what is said of elevator, aileron and rudder but by thrust.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from gtmbench.checks import number, shown
from gtmbench.detectors.surfaces.equations import THROTTLE, Flow, Frame, Regressing, causes_beside, engine_of
from gtmbench.detectors.tables import array_of, keys, names_of, table_of
from gtmbench.errors import InputError
from gtmbench.values.channels import COMMANDS, SURFACES
from gtmbench.values.record import BoolArray, FloatArray

BLOCK_S = 0.1  # between judgements, or a sample where there are fewer
ENOUGH = 0.8  # of blocks, or of a block's samples, that must be there


class DeviationBlocks(NamedTuple):
    """Means over blocks of a tenth of a second, side by side with what was commanded.

    Of every surface 1; u, what was commanded, behind servo and lag; v, how fast that changes, as a servo sees it that
    is slow by some tenths of a second; and d, by how much it seems to be off: in degrees, of the throttle in steps.
    """

    means: FloatArray  # shape (blocks, surfaces, 4)
    there: BoolArray  # shape (blocks,): whether enough samples of a block were
    block_s: float


def rows_of(sample_period_s: float) -> int:
    """Return the samples of a block."""
    return max(round(BLOCK_S / sample_period_s), 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Answer:
    """What was identified."""

    frame: Frame
    # by equation: effects: first those of the surfaces, in their order, 0 where there is none
    theta: Mapping[str, FloatArray]
    covariance: FloatArray  # shape (equations, equations): S, of what the equations leave on healthy flight

    @property
    def effects(self) -> FloatArray:
        """G: the effect of a degree of each surface on every equation, shape (equations, surfaces)."""
        return np.array([self.theta[name][: len(self.frame.surfaces)] for name in self.frame.equations])

    def start(self, sample_period_s: float) -> Answering:
        """Return what makes deviations of samples as they come in."""
        return Answering(self, sample_period_s)

    def table(self) -> dict[str, object]:
        """Return it as plain values."""
        frame = self.frame
        return {
            "vanes": frame.flow.vanes,
            "airspeed": frame.flow.airspeed,
            "forward": frame.flow.forward,
            "surfaces": list(frame.surfaces),
            "servo_s": frame.servo_s,
            "engine": frame.engine.table(),
            "reference": frame.reference,
            "theta": {name: values.tolist() for name, values in self.theta.items()},
            "covariance": self.covariance.tolist(),
        }


class Answering:
    """An answer at work; its filters begin at rest in the first sample, and a missing sample holds the last one."""

    def __init__(self, answer: Answer, sample_period_s: float) -> None:
        self._answer, self._period_s = answer, sample_period_s
        self._regressing = Regressing(answer.frame, sample_period_s)
        self._by_air = np.array([name != THROTTLE for name in answer.frame.surfaces])
        root = np.linalg.cholesky(answer.covariance)
        self._off = np.linalg.pinv(np.linalg.solve(root, answer.effects)) @ np.linalg.inv(root)

    def push(self, values: FloatArray) -> DeviationBlocks:
        """Return the whole blocks of the next rows, of the channels in their order."""
        rows = rows_of(self._period_s)
        values = values[: len(values) // rows * rows]
        made = self._regressing.push(values)
        residuals = np.column_stack(
            [made.explained[name] - made.regressors[name] @ theta for name, theta in self._answer.theta.items()]
        )
        off = (residuals @ self._off.T) / np.where(self._by_air, made.pressure[:, np.newaxis], 1.0)
        x = np.stack([np.ones_like(off), made.commanded, made.slew, off], axis=-1)
        there = np.isfinite(values).all(axis=1).reshape(-1, rows).mean(axis=1) >= ENOUGH
        means = x.reshape(-1, rows, *x.shape[1:]).mean(axis=1)
        return DeviationBlocks(means=means, there=there, block_s=rows * self._period_s)


def answer_of(where: str, given: Any) -> Answer:
    """Return the answer of a table, every key checked. InputError naming the key, what stands there and what should."""
    names = (
        "vanes",
        "airspeed",
        "forward",
        "surfaces",
        "servo_s",
        "engine",
        "reference",
        "theta",
        "covariance",
    )
    table = keys(where, given, names)
    for key in ("vanes", "airspeed", "forward"):
        if not isinstance(table[key], bool):
            raise InputError(f"{where}.{key} is {shown(table[key])}; it must be true or false")
    flow = Flow(vanes=table["vanes"], airspeed=table["airspeed"], forward=table["forward"])
    known = COMMANDS if flow.forward else SURFACES
    surfaces = names_of(f"{where}.surfaces", table["surfaces"])
    if not set(surfaces) & set(SURFACES) or not set(surfaces) <= set(known):
        raise InputError(f"{where}.surfaces is {shown(table['surfaces'])}; it may hold {', '.join(known)}")
    frame = Frame(
        flow=flow,
        surfaces=surfaces,
        servo_s=number(f"{where}.servo_s", table["servo_s"], 0.0, above=True),
        engine=engine_of(f"{where}.engine", table["engine"]),
        reference=number(f"{where}.reference", table["reference"], 0.0, above=True),
    )
    theta = table_of(f"{where}.theta", table["theta"])
    equations = frame.equations
    if list(theta) != list(equations):
        raise InputError(f"{where}.theta holds {', '.join(theta)}; it must hold {', '.join(equations)}")
    lengths = {name: len(surfaces) + causes_beside(axis, surfaces) for name, axis in equations.items()}
    answer = Answer(
        frame=frame,
        theta={name: array_of(f"{where}.theta.{name}", theta[name], (length,)) for name, length in lengths.items()},
        covariance=array_of(f"{where}.covariance", table["covariance"], (len(equations), len(equations))),
    )
    try:
        np.linalg.cholesky(answer.covariance)
    except np.linalg.LinAlgError:
        raise InputError(f"{where}.covariance is no covariance; calibrate anew") from None
    return answer
