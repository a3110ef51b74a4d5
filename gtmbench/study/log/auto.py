"""Bank auto for logs: the relations that every one of them allows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gtmbench.checks import naming
from gtmbench.detectors.auto import AutoDetector
from gtmbench.detectors.bank.composed import unwatched
from gtmbench.detectors.protocol import Detector, Monitor
from gtmbench.intake.open import log_channels


def fitted(
    watcher: Detector | Monitor, paths: Sequence[Path], mapping: Sequence[str]
) -> tuple[Detector | Monitor, list[str]]:
    """Return what watches, bank auto as the bank that logs allow; and which gyros that can't watch, and why.

    Its attitude is taken to come from the gyros where any log's format says so.

    Raises
    ------
    InputError
        Naming a log that can't be read; or the first, where they allow no relation.
    """
    if not isinstance(watcher, AutoDetector):
        return watcher, []
    first, *others = (log_channels(path, mapping=mapping) for path in paths)
    there = [name for name in first.names if all(name in other.names for other in others)]
    driven = any(log.attitude_from_gyros for log in (first, *others))
    with naming(paths[0]):
        detector = watcher.bank_for(there, attitude_from_gyros=driven)
    return detector, list(unwatched(detector.bank, there))
