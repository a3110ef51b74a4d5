"""True update rates: samples that a log only repeats until the next one comes are found, jointly over a sensor's axes.

A telemetry link or a slow task logs an attitude at 20 Hz that is fresh at 2.5. Repeats aren't measurements: derivatives
of such angles are spikes. One axis may well read the same twice; all of them together, again and again for as long,
don't.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gtmbench.errors import InputError
from gtmbench.intake.flight_log import Remark, remark
from gtmbench.intake.formats.limits import check_values
from gtmbench.intake.mapping import ChosenColumn
from gtmbench.intake.stamps import Clock, own_rows, single
from gtmbench.intake.tracks import Track
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, GYROS
from gtmbench.values.clock import FloatArray
from gtmbench.values.ranges import OutOfRange
from gtmbench.values.record import sealed

SENSORS = (GYROS, ATTITUDE, ACCELEROMETERS, ("alpha", "beta"))  # axes measured at once
_FEWEST = 20  # readings: of fewer nothing is regular
_USUAL = 2.0  # times the median: what stands longer says nothing about the rate

_Groups = dict[tuple[bytes | str, float], tuple[FloatArray, dict[str, FloatArray]]]  # stamps, and columns, by clock


def tracks_of(
    chosen: Sequence[ChosenColumn],
    clocks: Mapping[str, Clock],
    breaks_s: Sequence[float],
    witnesses: Sequence[ChosenColumn] = (),
) -> tuple[list[Track], list[Track], list[Remark], list[OutOfRange]]:
    """Return the channels by their stamps, every sample once and none that only repeats another; and remarks.

    Last, the readings that no sensor reads: they are missing.

    Between them, the witnesses that can be read. Theirs lie in memory behind the channels of the same stamps, so that
    they can stand beside them without a copy; what becomes of the channels doesn't depend on them.
    """
    groups: _Groups = {}
    beyond = [found for choice in chosen if (found := _group(choice, clocks, groups)) is not None]
    for choice in witnesses:
        with contextlib.suppress(InputError):
            check_values(len(clocks[choice.series.clock].time_s), "a sensor beside it")
            _group(choice, clocks, groups)
    names = {choice.channel for choice in witnesses}
    tracks: list[Track] = []
    apart: list[Track] = []
    remarks: list[Remark] = []
    for (key, late_s), (at_s, columns) in groups.items():
        channels = tuple(name for name in columns if name not in names)
        of_witnesses = tuple(name for name in columns if name in names)
        matrix = _as_matrix(columns)
        breaks_at_s = [break_s - late_s for break_s in breaks_s]
        alone = of_witnesses  # each is judged by itself
        if channels:
            own = f"{channels[0]}: " if isinstance(key, bytes) else f"{key}: " if key else ""
            rows, time_s, values, told = single(own, at_s, matrix[:, : len(channels)], breaks_at_s)
            tracks.append(Track(channels=channels, time_s=time_s, values=values))
            remarks += told
            if of_witnesses and len(rows) == len(at_s) and np.may_share_memory(time_s, at_s):  # whatever they hold
                apart.append(Track(channels=of_witnesses, time_s=time_s, values=matrix[:, len(channels) :]))
                alone = ()
        for place, name in enumerate(alone, len(channels)):
            _, time_s, values, _ = single("", at_s, matrix[:, place : place + 1], breaks_at_s)
            apart.append(Track(channels=(name,), time_s=time_s, values=values))
    tracks, held = fresh(tracks)
    for each in beyond:
        last_s = max([each.first_s, *(end_s for _, end_s in each.spans)])
        held.append(remark("out of range", each.first_s, last_s, each.text, each.channel))
    return tracks, apart, remarks + held, beyond


def _group(choice: ChosenColumn, clocks: Mapping[str, Clock], groups: _Groups) -> OutOfRange | None:
    """Put a channel's samples to those of the same stamps; return which readings are out of range."""
    clock = clocks[choice.series.clock]
    values, outside, found = choice.at(clock)
    own = own_rows(clock.time_s, np.isfinite(values) | outside)
    key = choice.series.clock if own is None else own.tobytes()
    at_s = clock.time_s if own is None else clock.time_s[own]
    at_s = at_s - choice.late_s if choice.late_s else at_s
    groups.setdefault((key, choice.late_s), (at_s, {}))[1][choice.channel] = values if own is None else values[own]
    return found


def _as_matrix(columns: dict[str, FloatArray]) -> FloatArray:
    """Return columns beside each other, each in one stretch of memory; those given are let go one by one."""
    names = tuple(columns)
    matrix = np.empty((len(columns[names[0]]), len(names)), order="F")
    for place, name in enumerate(names):
        matrix[:, place] = columns.pop(name)
    return sealed(matrix)


def fresh(tracks: Iterable[Track]) -> tuple[list[Track], list[Remark]]:
    """Return tracks without repeats, those that had any on stamps of their own, and remarks that say so."""
    kept: list[Track] = []
    remarks: list[Remark] = []
    for track in tracks:
        rest = list(track.channels)
        for sensor in SENSORS:
            axes = [name for name in track.channels if name in sensor]
            rows = fresh_rows(track.only(axes).values) if len(axes) > 1 else None
            if rows is None:
                continue
            own = replace(track.only(axes), time_s=track.time_s[rows], logged_s=track.period_s)
            kept.append(replace(own, values=own.values[rows]))
            rest = [name for name in rest if name not in axes]
            text = (
                f"{kept[-1].label}: logged at {1 / track.period_s:.4g} Hz, fresh at {1 / kept[-1].period_s:.4g} Hz: "
                f"{len(track.time_s) - len(rows)} of {len(track.time_s)} samples repeat the one before and are left out"
            )
            remarks += [remark("held", track.time_s[0], track.time_s[-1], text, name) for name in axes[:1]]
        if rest:
            kept.append(track if len(rest) == len(track.channels) else track.only(rest))
    return kept, remarks


def fresh_rows(values: FloatArray) -> NDArray[np.int64] | None:
    """Return the rows at which a sensor's axes hold a new reading; None where every row may be one.

    Regular repeats are the log's; what stands still for longer is the sensor's, and keeps its samples at the true rate.

    `values`: shape (samples, axes).

    >>> angles = np.random.default_rng(1).standard_normal((50, 3))
    >>> fresh_rows(np.repeat(angles, 8, axis=0))[:4], fresh_rows(angles) is None
    (array([ 0,  8, 16, 24]), True)
    """
    changes = np.zeros(max(len(values) - 1, 0), dtype=bool)
    for column in values.T:
        changes |= column[1:] != column[:-1]
    count = np.count_nonzero(changes) + 1
    if count < _FEWEST or 2 * count > len(values):
        return None
    starts = np.concatenate([[0], np.flatnonzero(changes) + 1])
    lengths = np.diff(np.append(starts, len(values)))
    whole = lengths[1:-1]  # the first and the last may be cut
    usual = float(np.mean(whole[whole <= _USUAL * np.median(whole)]))
    loose = int(0.25 * usual)  # either way: a slow task's beat against the logger's
    regular = (whole >= np.floor(usual) - loose) & (whole <= np.ceil(usual) + loose)
    # most readings stand equally long; the rest are pauses, and what stands still
    if usual < 2.0 or np.mean(regular) < 0.8:
        return None
    counts = np.maximum(1, np.rint(lengths / usual).astype(np.int64))
    number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.asarray(np.repeat(starts, counts) + np.rint(usual * number), dtype=np.int64)
