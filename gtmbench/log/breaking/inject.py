"""Breaking a recorded flight: a trial's faults, put into a log's file where nothing else changes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gtmbench.errors import InputError
from gtmbench.faults.fault import Fault, check_of_sensor
from gtmbench.files.writing import atomic_write
from gtmbench.intake.contents import ChannelSamples, log_contents, log_samples, write_samples, write_table
from gtmbench.intake.formats.registry import is_written
from gtmbench.intake.read import ReadLog, read_log
from gtmbench.log.breaking.bent_attitude import bent_samples, following_in_log
from gtmbench.log.opening.driven_attitude import FROM_LOG
from gtmbench.values.attitude_estimators import AttitudeEstimator
from gtmbench.values.channels import ATTITUDE, GYROS, unit_of
from gtmbench.values.clock import FloatArray


@dataclass(frozen=True, kw_only=True)
class ChangedColumn:
    """The change of one column of a log.

    Attributes
    ----------
    channel, unit : str
        The channel, and its unit.
    column : str
        Its name in the log.
    samples, changed : int
        The number of samples, and of changed samples.
    first_s, last_s : float or None
        The times of the first and the last changed sample, on the log's clock; None without any.
    sample_period_s : float
        The nominal sample period in seconds, for faults that carry a state from sample to sample.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import gtmbench as gb
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     log, out = Path(folder, "log.csv"), Path(folder, "broken.csv")
    ...     _ = log.write_text(chr(10).join(["time_s,p_deg_s", "0,1.0", "1,1.0", "2,1.0"]))
    ...     changed = gb.inject_log(log, out, gb.Bias(channel="p", onset_s=1.0, size=0.5))
    >>> [(each.column, each.samples, each.changed, each.first_s) for each in changed]
    [('p_deg_s', 3, 2, 1.0)]
    """

    channel: str
    unit: str
    column: str
    samples: int
    changed: int
    first_s: float | None
    last_s: float | None
    sample_period_s: float


def inject_log(
    log: str | Path | ReadLog,
    out: str | Path,
    faults: Fault | Sequence[Fault],
    *,
    mapping: Sequence[str] = (),
    attitude: str | AttitudeEstimator = FROM_LOG,
) -> tuple[ChangedColumn, ...]:
    r"""Write a recorded flight with faults to `out`; of a CSV or a Parquet table nothing else changes.

    Logs of other formats become a CSV of their channels, in our headers and units, every sample at its own time
    (`becomes_table`).

    Faults act one after the other on the samples in the file, at their own times. Effects that grow with time use the
    stamps; effects from sample to sample (a slew limit, a lag) use the column's nominal sample period. Missing samples
    stay missing. A channel that a fault only reads holds its last sample. If the gyros drive the attitude, phi, theta
    and psi become the estimator's result on the broken gyros, and faults of these act on that.

    Parameters
    ----------
    log : str, Path or ReadLog
    out : str or Path
    faults : Fault or sequence of Fault
        In the channel table's units, whatever the log's are; times on the clock that `open_log` gives.
    mapping : sequence of str
        As `open_log` takes it.
    attitude : str or AttitudeEstimator
        Whether the attitude follows a gyro's fault. "own": it is unchanged. "follows": an estimator computes it from
        the broken gyros, with the log's own time constant if it shows, else 5 s. "follows:2.5", or an estimator: with
        that time constant in seconds. "auto": it follows if the gyros drive it, which is assumed unless something shows
        otherwise.

    Raises
    ------
    InputError
        If the log can't be read or written, lacks a channel, or a fault begins outside of it, or where a bent
        attitude passes +-85 deg of pitch; nothing is written.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import gtmbench as gb
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     log, out = Path(folder, "log.csv"), Path(folder, "broken.csv")
    ...     _ = log.write_text("t [s],p [mrad/s],note\n0,1.0,a\n1,1.0,b\n2,1.0,c\n")
    ...     _ = gb.inject_log(log, out, gb.Drift(channel="p", onset_s=1.0, slope=0.5))
    ...     out.read_text().splitlines()
    ['t [s],p [mrad/s],note', '0,1.0,a', '1,1.0,b', '2,9.7,c']
    """
    read, out = read_log(log), Path(out)
    log = read.path
    listed = [faults] if isinstance(faults, Fault) else list(faults)
    for fault in listed:
        check_of_sensor(fault)
    changed = list(dict.fromkeys(name for fault in listed for name in fault.changes))
    estimator = following_in_log(read, changed, mapping, attitude=attitude).estimator
    wanted = dict.fromkeys(name for fault in listed for name in fault.reads)
    bends: list[str] = []
    if estimator is not None:
        there = log_contents(read, mapping=mapping).usable
        bends = [name for name in ATTITUDE if name in there]
        wanted |= dict.fromkeys(name for name in (*GYROS, *bends) if name in there)
    changed = list(dict.fromkeys([*changed, *bends]))
    as_table = becomes_table(read, changed, mapping)
    if as_table:
        wanted |= dict.fromkeys(log_contents(read, mapping=mapping).usable)
    samples = log_samples(read, list(wanted), mapping)
    _check_apart({name: samples[name] for name in changed})
    for fault in listed:
        _check_onset(fault, samples[fault.channel], log)
    healthy = {name: each.values for name, each in samples.items()}
    values = _all_broken(listed, samples, healthy)
    if estimator is not None:
        own = {name: samples[name] for name in (*GYROS, *ATTITUDE) if name in samples}
        followed = bent_samples(estimator, own, {name: values[name] for name in GYROS if name in own})
        values = _all_broken(listed, samples, healthy | followed)
    with atomic_write(out) as aside:
        if as_table:
            write_table(aside, samples, values)
        else:
            write_samples(log, aside, samples, {name: values[name] for name in changed})
    return tuple(_changed(samples[name], values[name]) for name in changed)


def becomes_table(log: ReadLog, changed: Iterable[str], mapping: Sequence[str] = ()) -> bool:
    """Tell whether a log becomes a CSV of its channels: its format isn't written, or what changes has no column."""
    if not is_written(log.path):
        return True
    made = {series.name for series in log.raw.series if series.made_of}
    columns = {channel.name: channel.column for channel in log_contents(log, mapping=mapping).channels}
    return any(columns.get(name) in made for name in changed)


def left_out(log: ReadLog, mapping: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the columns that aren't in the CSV that a log becomes."""
    contents = log_contents(log, mapping=mapping)
    kept = {channel.column for channel in contents.channels if not channel.why_not}
    return tuple(column.name for column in contents.columns if column.name not in kept and column.channel != "time")


def _all_broken(
    faults: Sequence[Fault], samples: Mapping[str, ChannelSamples], values: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """Return the values of all samples with faults, each of which acts on what those before it left."""
    broken = dict(values)
    for fault in faults:
        broken |= {part.channel: _broken(part, samples, broken) for part in fault.parts}
    return broken


def _broken(fault: Fault, samples: Mapping[str, ChannelSamples], values: Mapping[str, FloatArray]) -> FloatArray:
    own = samples[fault.channel]
    readings = [_held(samples[name].time_s, values[name], own.time_s) for name in fault.reads[1:]]
    return fault.broken(np.column_stack([values[fault.channel], *readings]), own.time_s, own.sample_period_s)


def _held(time_s: FloatArray, values: FloatArray, at_s: FloatArray) -> FloatArray:
    """Return what a channel last told at some times; before its first sample, that."""
    return values[np.maximum(np.searchsorted(time_s, at_s, side="right") - 1, 0)]


def _check_apart(changed: Mapping[str, ChannelSamples]) -> None:
    columns = [each.chosen.series.name for each in changed.values()]
    twice = next((name for name in columns if columns.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"column '{twice}' is mapped to {' and '.join(changed)}, and both break; map one of them")


def _check_onset(fault: Fault, samples: ChannelSamples, log: Path) -> None:
    first_s, last_s = samples.span_s
    if not first_s - 1e-9 <= fault.onset_s <= last_s + 1e-9:
        raise InputError(
            f"{fault.kind} on '{fault.channel}' begins at {fault.onset_s:g} s, outside of {log.name}, which runs "
            f"from {first_s:.10g} to {last_s:.10g} s; change its onset_s"
        )


def _changed(samples: ChannelSamples, values: FloatArray) -> ChangedColumn:
    cells = samples.cells(values)
    times_s = samples.time_s[np.isin(samples.rows, cells.rows)]
    return ChangedColumn(
        channel=samples.chosen.channel,
        unit=unit_of(samples.chosen.channel),
        column=samples.chosen.series.name,
        samples=len(samples.rows),
        changed=len(cells.rows),
        first_s=float(times_s[0]) if len(times_s) else None,
        last_s=float(times_s[-1]) if len(times_s) else None,
        sample_period_s=samples.sample_period_s,
    )
