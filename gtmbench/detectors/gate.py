"""The gate before every monitor: readings that no sensor reads are missing, counted and told; many aren't judged."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import wraps
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from gtmbench.errors import NoteWarning
from gtmbench.jobs.threads import on_one_thread
from gtmbench.values.ranges import OutOfRange, within_range
from gtmbench.values.record import BoolArray, Record, check_record

if TYPE_CHECKING:
    from gtmbench.detectors.protocol import Score, Watch

_Watch = TypeVar("_Watch", bound="Watch")
_Method = TypeVar("_Method", bound=Callable[..., Any])


def gated(method: _Method) -> _Method:
    """Return a monitor's `watch`, behind the gate."""

    @wraps(method)
    def watch(self: Any, record: Record, **given: Any) -> Any:
        return watch_inside(lambda inside: method(self, inside, **given), record)

    return cast("_Method", watch)


@on_one_thread
def watch_inside(watch: Callable[[Record], _Watch], record: Record) -> _Watch:
    """Return the watch of what of a record lies in its channels' ranges.

    Where more than one reading in a hundred of a second is outside, no score that the channel enters is armed.
    """
    inside, found = _inside(record)
    watched = watch(inside)
    if not found:
        return watched
    scores = {name: _disarmed(score, inside, found) for name, score in watched.scores.items()}
    return replace(watched, scores=MappingProxyType(scores), out_of_range=found)


def taken_inside(chunk: Record) -> Record:
    """Return what of a stream's chunk lies in its channels' ranges."""
    return _inside(chunk)[0]


def _inside(record: Record) -> tuple[Record, tuple[OutOfRange, ...]]:
    check_record(record)
    inside, found = within_range(record)
    for each in found:
        warnings.warn(NoteWarning(each.text), stacklevel=5)
    return inside, found


def _disarmed(score: Score, record: Record, found: Iterable[OutOfRange]) -> Score:
    """Return a score that isn't armed where too many readings of a channel that enters it are outside."""
    spans = [span for each in found if not score.channels or each.channel in score.channels for span in each.spans]
    unjudged: BoolArray = np.zeros(len(record), dtype=bool)
    for start_s, end_s in spans:
        unjudged |= (record.time_s >= start_s) & (record.time_s <= end_s)
    return replace(score, armed=score.armed & ~unjudged) if spans else score
