"""A gyro that hardly reads its turns any more: what it lacks is a share of what the attitude turns.

A gain of what is read can't say that, for next to nothing is read. An angle that turns by itself looks alike, so that
it stays a suspect beside its gyro (`engine/doubts.py`).
"""

from __future__ import annotations

from functools import partial

import numpy as np

from gtmbench.engine.explanation import Explanation
from gtmbench.engine.flight import Flight
from gtmbench.engine.relation import Effect, on_axis
from gtmbench.values.channels import GYROS

DEAD = "dead"
_LEAST, _MOST = 0.8, 1.3  # of each turn that is lacking; what lacks less is a gain of what is read, down to a fifth
_PRICE, _SHORTEST_S = 2.0, 7.0  # as of a gain: in less it is another motion


def explanations(flight: Flight) -> list[Explanation]:
    """Return them, of size one where nothing is read; none where the attitude would follow the gyro."""
    if flight.is_driven and not flight.is_assumed:
        return []
    return [
        Explanation(
            suspect=gyro,
            kind=DEAD,
            effect=partial(_lacking, axis=axis),
            price=_PRICE,
            low=0.0,
            high=_MOST,
            least=_LEAST,
            shortest_s=_SHORTEST_S,
            is_gain=True,
            of_turns=True,
        )
        for axis, gyro in enumerate(GYROS)
    ]


def _lacking(flight: Flight, *, axis: int) -> Effect:
    return Effect(gains=on_axis(-np.nan_to_num(flight.blocks.rates[:, axis]), axis))
