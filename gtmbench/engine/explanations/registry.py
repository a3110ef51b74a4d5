"""All explanations of a flight's errors that compete."""

from __future__ import annotations

from gtmbench.engine.explanation import Explanation
from gtmbench.engine.explanations import angle, dead, gyros, installation, noise, references
from gtmbench.engine.flight import Flight
from gtmbench.engine.imus import explanations as of_imus

KINDS = (gyros, dead, angle, references, installation, noise, of_imus)


def explanations_of(flight: Flight) -> tuple[Explanation, ...]:
    """Return the explanations of a flight; those of an infinite price are only what others grow from."""
    return tuple(each for kind in KINDS for each in kind.explanations(flight))
