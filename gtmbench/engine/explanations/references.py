"""References that pull an estimator's attitude about: they lean with bank or pitch, or take back a part of each turn.

Apparent gravity and GPS courses do that in health. Nothing failed then, and nothing is clear.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from gtmbench.engine.explanation import TIMES_S, Explanation, followed
from gtmbench.engine.flight import Flight, means_about
from gtmbench.engine.relation import Effect, on_axis
from gtmbench.values.channels import GYROS

_LEAN, _LEAN_LOW, _LEAN_HIGH = 0.005, -0.3, 0.6  # deg/s a deg
_TURNS, _MOST, _MOST_YAW = 0.05, 0.7, 0.9  # the share of a turn that they take back
_COMES_BACK_S = 30.0  # a turn of p or q comes back within it; what doesn't is an offset


def explanations(_: Flight) -> list[Explanation]:
    """Return them; the size of a lean is in deg/s a deg, of turns the share that is taken back."""
    leans = {"lean of bank": (0,), "lean of pitch": (1,), "lean": (0, 1)}
    found = [
        Explanation(
            suspect="references",
            kind=kind,
            effect=partial(_lean, axes=axes),
            low=_LEAN_LOW,
            high=_LEAN_HIGH,
            least=_LEAN,
            is_healthy=True,
            axes=axes,
        )
        for kind, axes in leans.items()
    ]
    for fades_s in TIMES_S:
        for axis, gyro in enumerate(GYROS):
            found.append(
                Explanation(
                    suspect="references",
                    kind=f"turns of {gyro} over {fades_s:g} s",
                    effect=partial(_turns, axis=axis, fades_s=fades_s),
                    low=0.0,
                    high=_MOST_YAW if gyro == "r" else _MOST,
                    least=_TURNS,
                    is_healthy=True,
                    axes=(axis,),
                )
            )
    return found


def _lean(flight: Flight, *, axes: tuple[int, ...]) -> Effect:
    pulled = sum(on_axis(flight.angles[:, axis], axis) for axis in axes)
    return Effect(turning=-np.einsum("nij,nj->ni", flight.matrices, pulled))


def _turns(flight: Flight, *, axis: int, fades_s: float) -> Effect:
    """Return the pull by which a share of each turn is taken back: its low pass, over the time constant."""
    turns = flight.gyros[:, axis]
    if axis < 2:
        turns = turns - means_about(turns, round(0.5 * _COMES_BACK_S / flight.blocks.period_s))
    turned, _ = followed(flight, on_axis(turns, axis), fades_s)
    return Effect(turning=-turned / fades_s)
