"""What looks wrong in a channel: missing samples, standing still, limits that are reached, a sign that is turned."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gtmbench.intake.flight_log import Remark, remark
from gtmbench.intake.tracks import Track
from gtmbench.values.channels import COMMANDS
from gtmbench.values.clock import FloatArray
from gtmbench.values.record import runs

_STUCK_S, _FEWEST = 1.0, 20  # a channel that stays at a value for longer than both, and longer than it is used to
_AT_REST = 0.1  # of the other channels' usual movement: the aircraft stands, nothing is stuck
_PILED = 5  # times as many samples at the extreme as at any of the three levels beside it


def remarks_on(track: Track, judged: Sequence[str], others: Sequence[Track]) -> list[Remark]:
    """Return remarks on a track's channels; of all, what is missing; of the `judged`, what looks wrong."""
    remarks = []
    for channel, values in zip(track.channels, track.values.T, strict=True):
        remarks += _missing(channel, track.time_s, values)
        if channel in judged and channel not in COMMANDS:  # a command may stand still, or at its limit
            remarks += _constant(channel, track.time_s, values, [*others, track])
            remarks += _saturated(channel, track.time_s, values)
        if channel == "nz" and np.isfinite(values).any():
            remarks += _sign(track.time_s, values)
    return remarks


def _missing(channel: str, time_s: FloatArray, values: FloatArray) -> list[Remark]:
    lost = ~np.isfinite(values)
    if not lost.any():
        return []
    starts, ends = runs(lost)
    longest = int((ends - starts).max())
    text = (
        f"{channel}: {np.count_nonzero(lost)} of {len(values)} samples are missing (NaN or out of range), in "
        f"{len(starts)} places, at most {longest} in a row; more than two in a row stay missing"
    )
    return [remark("missing", time_s[starts[0]], time_s[ends[-1] - 1], text, channel)]


def _constant(channel: str, time_s: FloatArray, values: FloatArray, others: Sequence[Track]) -> list[Remark]:
    there = np.isfinite(values)
    if np.count_nonzero(there) < _FEWEST:
        return []
    if not there.all():
        time_s, values = time_s[there], values[there]
    if np.all(values == values[0]):
        text = f"{channel} is {values[0]:.6g} from start to end: constant"
        return [remark("constant", time_s[0], time_s[-1], text, channel)]
    bounds = np.concatenate([[0], np.flatnonzero(values[1:] != values[:-1]) + 1, [len(values)]])
    lengths = np.diff(bounds)
    if lengths.max() < _FEWEST:
        return []
    used_to = float(np.sort(lengths)[-min(len(lengths), 2 + len(lengths) // 1000)])
    remarks = []
    # ten times the longest of its other stays, but one
    stays = np.flatnonzero((lengths >= _FEWEST) & (lengths > 10 * used_to))
    for place in np.sort(stays[np.argsort(lengths[stays])][-20:]):  # the longest, of one channel
        start_s, end_s = float(time_s[bounds[place]]), float(time_s[bounds[place + 1] - 1])
        if end_s - start_s >= _STUCK_S and _others_move(channel, others, start_s, end_s):
            text = (
                f"{channel} stays at {values[bounds[place]]:.6g} for {end_s - start_s:.4g} s while others move: stuck?"
            )
            remarks.append(remark("constant", start_s, end_s, text, channel))
    return remarks


def _others_move(channel: str, others: Sequence[Track], start_s: float, end_s: float) -> bool:
    """Tell whether the other channels move in a span as they usually do; True where nothing else could tell."""
    shares = []
    for track in others:
        first, last = np.searchsorted(track.time_s, [start_s, end_s])
        for name, values in zip(track.channels, track.values.T, strict=True):
            moves = np.abs(np.diff(values))
            usual = _mean(moves)
            if name != channel and usual > 0 and last - first > 2:
                shares.append(_mean(moves[first : last - 1]) / usual)
    return not shares or float(np.median(shares)) > _AT_REST


def _saturated(channel: str, time_s: FloatArray, values: FloatArray) -> list[Remark]:
    remarks = []
    for extreme, side in ((np.nanmax, "greatest"), (np.nanmin, "smallest")):
        if not np.isfinite(values).any():
            return []
        limit = float(extreme(values))
        at_limit = values == limit
        starts, ends = runs(at_limit)
        if len(starts) < 3 or np.count_nonzero(at_limit) <= _FEWEST:
            continue
        levels, counts = np.unique(values[np.isfinite(values)], return_counts=True)
        beside = counts[-4:-1] if side == "greatest" else counts[1:4]
        if len(levels) > 4 and np.count_nonzero(at_limit) > _PILED * int(beside.max()):
            count = int(np.count_nonzero(at_limit))
            share = f"{count} samples ({100 * count / len(values):.3g} %)"
            text = f"{channel}: {share} are exactly its {side} value, {limit:.6g}, in {len(starts)} places: at a limit?"
            remarks.append(remark("saturated", time_s[starts[0]], time_s[ends[-1] - 1], text, channel))
    return remarks


def _sign(time_s: FloatArray, values: FloatArray) -> list[Remark]:
    mean = _mean(values)
    low, high = 0.5, 1.5  # g: what a flight's mean should be between
    if low <= mean <= high:
        return []
    turned = -high <= mean <= -low
    why = "its sign is turned: map it with the other one" if turned else "its unit, its sign, or gravity taken off?"
    text = f"nz is {mean:.3g} g at the mean, level flight reads +1: {why}"
    return [remark("sign", time_s[0], time_s[-1], text, "nz")]


def _mean(values: FloatArray) -> float:
    there = values[np.isfinite(values)]
    return float(there.mean()) if len(there) else 0.0
