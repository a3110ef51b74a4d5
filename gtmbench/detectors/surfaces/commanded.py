"""What an aircraft was commanded and how it answered, in a stretch of a flight: both sides of every relation, by steps.

Where vanes, airspeed, nx and the attitude are read, one relation more holds whatever engine and surfaces do
(`equations.speeding`): the airspeed less the integral of what accelerometers tell is wind, which comes back.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from gtmbench.detectors.surfaces.equations import Frame, Regressing, speeding
from gtmbench.detectors.surfaces.identification import SETTLES_S, STEP_S, means_of, steps_of
from gtmbench.values.record import FloatArray

AIRSPEED = "tas"  # the relation's name: that of the channel which it explains
AIR_S = 0.5  # a step of it: wind lasts for seconds


@dataclass(frozen=True, kw_only=True, eq=False)
class Commanded:
    """A stretch of samples, without a hole."""

    start_s: float
    period_s: float
    channels: tuple[str, ...]  # gyros, flow and commands
    values: FloatArray = field(repr=False)  # shape (samples, channels)
    frame: Frame  # the equations of the answer

    def column(self, channel: str) -> FloatArray:
        """Return what a channel reads."""
        return np.asarray(self.values[:, self.channels.index(channel)])

    def off_by(self, channel: str, wrong: FloatArray) -> Commanded:
        """Return the same with something added to a channel."""
        values = self.values.copy()
        values[:, self.channels.index(channel)] += wrong
        return replace(self, values=values)

    def until(self, end_s: float) -> Commanded:
        """Return what is there until a time."""
        return replace(self, values=self.values[: round((end_s - self.start_s) / self.period_s)])

    def since(self, begin_s: float) -> Commanded:
        """Return what is there from a time on."""
        first = max(round((begin_s - self.start_s) / self.period_s), 0)
        return replace(self, start_s=self.start_s + first * self.period_s, values=self.values[first:])

    @property
    def end_s(self) -> float:
        """Until when."""
        return self.start_s + self.period_s * len(self.values)

    def rows(self, step_s: float) -> int:
        """Return how many samples are a step, of one at least."""
        return max(round(step_s / self.period_s), 1)

    @property
    def relations(self) -> dict[str, FloatArray]:
        """Of every relation its causes and, last, what is explained, step by step, once filters have settled."""
        return dict(self._relations())

    def _relations(self) -> Iterator[tuple[str, FloatArray]]:
        sides = Regressing(self.frame, self.period_s).sides(self.values)
        for name in self.frame.equations:
            yield name, steps_of(self.frame, name, sides, self.period_s)[self.settled(name) :]
        if self.frame.flow.forward:
            read = {name: self.values[:, i] for i, name in enumerate(self.channels)}
            wind = read["tas"] - self.period_s * np.cumsum(speeding(read))
            explained = means_of(wind, self.rows(AIR_S))[self.settled(AIRSPEED) :]
            minutes = np.arange(len(explained)) * self.step_s(AIRSPEED) / 60.0
            yield AIRSPEED, np.column_stack([np.ones(len(minutes)), minutes, explained])

    def step_s(self, relation: str) -> float:
        """Return how long a relation's step is."""
        return self.period_s * self.rows(AIR_S if relation == AIRSPEED else STEP_S)

    def settled(self, relation: str) -> int:
        """Return which step of a relation is the first once filters have settled."""
        return round(SETTLES_S / self.step_s(relation))
