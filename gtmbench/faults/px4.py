"""PX4's words for failures, as kinds of ours: what ``--fault px4_slow:r`` means.

PX4's developer guide, "System Failure Injection", says what each word means, and leaves to the simulator how it looks.
Where a word says less than a kind, or something else, its row says so.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from gtmbench.faults.intermittent import Intermittent

PREFIX = "px4_"


@dataclass(frozen=True, kw_only=True)
class Word:
    """A word of PX4's."""

    kind: str  # of ours
    parameters: Mapping[str, object] = field(default_factory=dict)  # of the kind, unless something else is given
    differs: str = ""  # where the two differ; "" where they don't


WORDS: Mapping[str, Word] = {
    "px4_off": Word(kind="dropout"),
    "px4_stuck": Word(kind="jam", differs="PX4 says the same value each time; which one is left to the simulator"),
    "px4_garbage": Word(
        kind="noise",
        parameters={"deviation": 500.0},
        differs="PX4 publishes random noise in place of readings; here it is normal, and added to them",
    ),
    "px4_wrong": Word(
        kind="bias", differs="PX4 says a wrong value that looks reasonable; here it is off by a size that you give"
    ),
    "px4_slow": Word(
        kind="stale",
        parameters={"hold_s": 0.1},
        differs="PX4 publishes at a lower rate; here the rate stays, and readings are repeated",
    ),
    "px4_delayed": Word(
        kind="delay", parameters={"delay_s": 0.5}, differs="PX4 says significantly late; here it is half a second"
    ),
    "px4_intermittent": Word(
        kind="dropout",
        parameters={"intermittent": Intermittent(period_s=2.0, duty=0.5, by_chance=True)},
        differs="PX4 doesn't say how often; here half of the time, for a second on average",
    ),
}
