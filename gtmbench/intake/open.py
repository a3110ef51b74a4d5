"""`open_log`: a recorded flight's file, as it comes, as clean segments and remarks."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from gtmbench.checks import names, number, one_line
from gtmbench.errors import InputError
from gtmbench.intake.events import Event, of_flight
from gtmbench.intake.flight_log import FlightLog, Source, summed_up
from gtmbench.intake.formats.limits import check_values
from gtmbench.intake.formats.raw import RawLog
from gtmbench.intake.fresh_samples import tracks_of
from gtmbench.intake.imus import imus_of
from gtmbench.intake.mapping import AS_IT_IS, ChosenColumn, choose, choose_of, not_taken, split_mapping
from gtmbench.intake.plausibility import remarks_on
from gtmbench.intake.published_failures import Injection, annotated_failures, in_time
from gtmbench.intake.read import ReadLog, read_log
from gtmbench.intake.segments import Cut, cut, laid_beside
from gtmbench.intake.stamps import Clock, cleaned, cleaned_alone
from gtmbench.intake.times import of_no_use, with_time
from gtmbench.intake.tracks import Track
from gtmbench.values.channels import ATTITUDE, SENSORS
from gtmbench.values.clock import FloatArray
from gtmbench.values.ranges import OutOfRange
from gtmbench.values.record import Record, with_columns


def open_log(
    path: str | Path | ReadLog,
    *,
    mapping: Sequence[str] = (),
    rate_hz: float | None = None,
    needs: Sequence[str] | None = None,
    witnesses: Sequence[str] = (),
) -> FlightLog:
    r"""Open a recorded flight: CSV, Parquet, PX4 ULog, ArduPilot DataFlash or MCAP, recognised by its first bytes.

    Columns become channels if name and unit leave no doubt (``p_rad_s``, ``roll [deg]``, ``GyrX (deg/s)``), or if the
    format documents them. Their units are converted to the channel table's. Records split at gaps; while a channel
    pauses and others continue, it is NaN. An evenly sampled log is read bit for bit. Other stamps are interpolated, and
    so are a lost sample or two if their neighbours predict them within the noise. Mixed rates are brought to the
    slowest. ``remarks`` says what was wrong, ``method`` what was done.

    Parameters
    ----------
    path : str, Path or ReadLog
        A log that was read before isn't read again.
    mapping : sequence of str
        ``CHANNEL=COLUMN:UNIT`` for columns whose names don't identify them: ``p=gyro_x:rad/s``, ``nz=-az:m/s2`` (a
        minus turns the sign), ``time=stamp:us``. The unit may be left out if the column states it. It may be followed
        by the delay of the column's stamps in seconds: ``psi=yaw:deg@0.3`` is taken 0.3 s earlier.
    rate_hz : float, optional
        Rate of the records; by default the slowest channel's.
    needs : sequence of str, optional
        The channels to return, in this order; others are then ignored. By default all that are recognised and, for
        tables, the other columns of numbers by their own names.
    witnesses : sequence of str, optional
        Channels for diagnosis only, included if the log has them; nothing else depends on them. They follow the others,
        on the same clock, and are NaN while they pause.

    Raises
    ------
    InputError
        If the file can't be read, lacks a needed channel (the message lists those that it has), or no stretch is long
        enough.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import gtmbench as gb
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "log.csv")
    ...     _ = path.write_text("t [ms],gyro_x (rad/s)\n" + "".join(f"{10 * k},0.5\n" for k in range(500)))
    ...     log = gb.open_log(path)
    >>> log.segments
    (Record(500 samples, 0..4.99 s, every 0.01 s: p),)
    >>> log.remarks[0].text
    'p is 28.6479 from start to end: constant'
    """
    rate = None if rate_hz is None else number("rate_hz", rate_hz, 1e-3, 1e6)
    wanted = None if needs is None else names("needs", needs)
    if wanted == ():
        raise InputError("needs is empty; name the channels that are wanted, or leave it out for all")
    columns = split_mapping(mapping)
    read = read_log(path)
    try:
        with np.errstate(all="ignore"):  # broken logs hold signalling NaNs and numbers that overflow: they become NaN
            return _opened(read.path, read.raw, columns, rate, wanted, tuple(witnesses))
    except InputError as error:
        raise InputError(f"{read.path}: {one_line(str(error))}") from error


def _opened(
    path: Path,
    raw: RawLog,
    columns: dict[str, str],
    rate_hz: float | None,
    needs: tuple[str, ...] | None,
    witnesses: tuple[str, ...],
) -> FlightLog:
    raw = with_time(raw, columns.pop("time", None))
    chosen = choose(raw, columns, needs)
    left_out = of_no_use(chosen, raw)
    if needs is None:
        chosen = [choice for choice in chosen if choice.channel not in left_out] or chosen
    elif left_out and len(left_out) < len(chosen):
        raise InputError("; ".join(f"{name}: {why}" for name, why in left_out.items()))
    used = dict.fromkeys(choice.series.clock for choice in chosen)
    clocks, breaks_s, remarks = cleaned({name: raw.clocks[name] for name in used})
    check_values(sum(len(clocks[choice.series.clock].time_s) for choice in chosen), "its channels")
    others = choose_of([name for name in witnesses if name not in {choice.channel for choice in chosen}], raw, columns)
    known = _clocks_of(others, raw, clocks, breaks_s)
    others = [choice for choice in others if choice.series.clock in known]
    tracks, apart, told, out_of_range = tracks_of(chosen, known, breaks_s, others)
    remarks += told
    suspects = [
        choice.channel
        for choice in chosen
        if choice.channel in SENSORS or choice.channel in columns or needs is not None
    ]
    for track in tracks:
        remarks += remarks_on(track, suspects, [other for other in tracks if other is not track])
    made = cut(tracks, breaks_s=breaks_s, rate_hz=rate_hz)
    segments = [record.select([choice.channel for choice in chosen]) for record in made.records]
    if needs is not None:
        _check_together(segments, tracks, out_of_range)
    taken = [f"{choice.channel} = {choice.how}" for choice in chosen if choice.how != AS_IT_IS]
    own = [choice.channel for choice in chosen if choice.how == AS_IT_IS]
    if own:
        taken.append(f"by their own names, values as they are: {', '.join(own[:40])}{' ...' if len(own) > 40 else ''}")
    segments, beyond = _with_witnesses(segments, [choice.channel for choice in others], apart, breaks_s, made)
    if beyond:
        read = "; ".join(f"{choice.channel} = {choice.how}" for choice in others if choice.channel in beyond)
        taken.append(f"used for diagnosis only, never for alarms: {read}")
    events, unplaced = _events(raw, breaks_s, segments)
    left = []
    if needs is None:
        left = [f"not taken: {name}, {why}" for name, why in left_out.items()]
        left += not_taken(raw, [choice.channel for choice in chosen])
    sources = [replace(choice.source, period_s=made.periods_s[choice.channel]) for choice in chosen]
    if raw.time is not None:
        sources.append(Source(channel="time", column=raw.time[0], unit=raw.time[1], guessed=raw.time_guessed))
    return FlightLog(
        path=path,
        segments=tuple(segments),
        remarks=summed_up(remarks + made.remarks),
        method=tuple(map(one_line, (f"read as {raw.kind}", *raw.notes, *taken, *left, *made.method, *unplaced))),
        sources=tuple(sources),
        events=events,
        injections=_injections(path, raw, breaks_s, segments),
        imus=imus_of(raw),
        attitude_from_gyros=raw.attitude_from_gyros and not set(ATTITUDE) <= set(columns),
        is_received=raw.is_received,
        unread=made.unread,
        out_of_range=tuple(out_of_range),
        periods_s=made.periods_s | {name: each.period_s for each in apart for name in each.channels if name in beyond},
    )


def _check_together(segments: Sequence[Record], tracks: Sequence[Track], out_of_range: Sequence[OutOfRange]) -> None:
    """Refuse channels that nowhere have a sample together: clocks in other units, or stamps that come in bursts."""
    if any(np.isfinite(record.values).all(axis=1).any() for record in segments):
        return
    if out_of_range:
        told = "; ".join(each.text for each in out_of_range)
        raise InputError(f"{told}; nothing is left to be watched: is the unit right? --map CHANNEL=COLUMN:UNIT")
    spans = "; ".join(
        f"{track.label} from {track.time_s[0]:.6g} to {track.time_s[-1]:.6g} s, {track.period_s:.3g} s apart"
        for track in tracks
    )
    raise InputError(
        f"no moment has a sample of each channel ({spans}): their clocks count from another moment or in another unit, "
        f"or tell when bursts arrived; give a log with the sensors' own times"
    )


def _events(
    raw: RawLog, breaks_s: tuple[float, ...], segments: Sequence[Record]
) -> tuple[tuple[Event, ...], tuple[str, ...]]:
    """Return the events of a log, and a word on those that can't be placed: where its clock isn't as they have it."""
    told = raw.events()
    if told and not _is_placed(raw, breaks_s):
        why = "its clock was set back" if breaks_s else f"the time is taken from '{raw.time[0] if raw.time else ''}'"
        return (), (f"{len(told)} events of the log aren't taken, for {why}: when they were isn't known",)
    return of_flight(told, segments[0].start_s, segments[-1].end_s), ()


def _injections(
    path: Path, raw: RawLog, breaks_s: tuple[float, ...], segments: Sequence[Record]
) -> tuple[Injection, ...]:
    """Return the failures that came before a log's end and weren't over at its beginning: by itself, or beside it."""
    start_s, end_s = segments[0].start_s, segments[-1].end_s
    told = (*raw.injections(), *annotated_failures(path)) if _is_placed(raw, breaks_s) else ()
    return in_time(each for each in told if each.onset_s < end_s and (each.end_s is None or each.end_s > start_s))


def _is_placed(raw: RawLog, breaks_s: tuple[float, ...]) -> bool:
    """Tell whether the log's clock is as its messages have it."""
    return not breaks_s and raw.time is None


def _clocks_of(
    witnesses: Sequence[ChosenColumn], raw: RawLog, clocks: Mapping[str, Clock], breaks_s: tuple[float, ...]
) -> dict[str, Clock]:
    """Return clocks with those of the witnesses beside them; without those that were set back."""
    known = dict(clocks)
    for name in {choice.series.clock for choice in witnesses} - known.keys():
        if not breaks_s and (own := cleaned_alone(raw.clocks[name])) is not None:
            known[name] = own
    return known


def _with_witnesses(
    segments: list[Record], order: Sequence[str], tracks: Sequence[Track], breaks_s: tuple[float, ...], made: Cut
) -> tuple[list[Record], list[str]]:
    """Return segments with the witnesses behind the channels, in their order, and which these are."""
    laid: dict[str, list[FloatArray]] = {}
    for track in tracks:
        with contextlib.suppress(InputError):
            of = [laid_beside(track, record, breaks_s=breaks_s, filtered=made.filtered) for record in made.records]
            laid |= {name: [values[:, i : i + 1] for values in of] for i, name in enumerate(track.channels)}
    names = [name for name in order if any(np.isfinite(values).any() for values in laid.get(name, ()))]
    if not names:
        return segments, []
    return [with_columns(record, names, [laid[name][i] for name in names]) for i, record in enumerate(segments)], names
