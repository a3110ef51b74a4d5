"""The dissertation's plants that more than one place needs; those of a single script stand there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from gtmbench.values.record import FloatArray
from theory.state_space import StateSpace, companion, lqr

_ZEROS: Final = (0.4j, -0.4j, 0.3, -0.3)  # of (3.1), (3.5) and (3.98)


@dataclass(frozen=True, kw_only=True, eq=False)
class Example:
    """A plant and the LQR gain that stabilises it."""

    plant: StateSpace
    gain: FloatArray


def _siso(*poles: complex) -> StateSpace:
    return companion(np.poly(_ZEROS).real, np.poly(poles).real)


def _regulated(plant: StateSpace, state_weight: float = 1.0) -> Example:
    return Example(plant=plant, gain=lqr(plant, state_weight * np.eye(plant.order), np.eye(plant.inputs)))


def example_3_2_1() -> StateSpace:
    """Return (3.1), which is asymptotically stable and needs no loop."""
    return _siso(-0.8, -0.7, -0.6, 0.7, 0.6, 0.5j, -0.5j)


def example_3_2_2() -> Example:
    """Return (3.5), which the figures belong to.

    The printed A of (3.6) realises (3.1) with the pole 0.6 moved to 1.6, and the printed K of (3.8) is that one's:
    `example_3_2_2_as_printed`.
    """
    return _regulated(_siso(-0.6, 0.7, 0.5j, -0.5j, 1.6, 1.7, 1.8))


def example_3_2_2_as_printed() -> Example:
    """Return (3.6), (3.7), a plant with one unstable pole, whose gain is the printed (3.8)."""
    return _regulated(_siso(-0.8, -0.7, -0.6, 0.7, 1.6, 0.5j, -0.5j))


def example_3_1() -> Example:
    """Return (3.95) by its realisation (3.96), with Q = 2 I and R = I; the gain is (3.97)."""
    plant = StateSpace(
        A=[[1.5, 0.2], [2.0, 0.5]], B=[[1.0, -1.0], [-1.0, 3.0]], C=[[1.0, 2.0], [0.0, -4.0]], D=np.zeros((2, 2))
    )
    return _regulated(plant, state_weight=2.0)


def example_3_2() -> Example:
    """Return (3.98) in companion form, which the printed gain (3.99) belongs to, though the text doesn't say so."""
    return _regulated(_siso(-0.7, -0.6, 0.5j, -0.5j, 1.8, 1.7, 1.6))
