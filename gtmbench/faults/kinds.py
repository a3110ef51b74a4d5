"""The kinds of faults, by name, in three families: what is added, how the signal is shaped, what takes its place.

A new fault is a class in one of their files with its `kind`, its parameters (declared as in `parameter`) and a formula
(`Formula`), or `distort` or `distort_sample` (and `begin`, where it carries something over), and an entry here; a
user's own is registered (`registry`). With an entry in `detectors/isolation/hypotheses.py` that says how its parameters
are searched, a diagnosis knows it, too.
"""

from __future__ import annotations

from gtmbench.faults.additive import Bias, Drift, GSensitivity, Noise, Oscillation, RandomWalk, Spikes
from gtmbench.faults.fault import Fault
from gtmbench.faults.replacing import Delay, Dropout, Float, Hardover, Jam, Stale, Stuck, Swap
from gtmbench.faults.shaping import (
    Deadzone,
    Hysteresis,
    Lag,
    Misalignment,
    Quantisation,
    RateSaturation,
    Saturation,
    ScaleFactor,
    SignFlip,
)

_KINDS: tuple[type[Fault], ...] = (
    *(Drift, Deadzone, Saturation, RateSaturation, Jam),  # the dissertation's
    *(Bias, RandomWalk, Oscillation, ScaleFactor, SignFlip, Noise, Spikes, Dropout, Stuck, Hardover),
    *(Hysteresis, Quantisation, Lag, Delay, Stale, Misalignment, Swap, GSensitivity),
    *(Float,),  # of surfaces alone, as physics goes
)
FAULTS: dict[str, type[Fault]] = {kind.kind: kind for kind in _KINDS}
