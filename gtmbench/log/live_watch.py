"""A log watched as a live source would send it: alarms as they come, nothing of it kept."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.assumptions import basis_of
from gtmbench.detectors.installation.learner import Corrector, Learner, expected_of, has_motion
from gtmbench.detectors.protocol import Monitor, Stream
from gtmbench.errors import InputError
from gtmbench.intake.row_by_row import live_chunks
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.clock import SLACK
from gtmbench.values.record import Record


def watch_live(path: str | Path, monitor: Monitor, *, mapping: Sequence[str] = ()) -> Iterator[tuple[Alarm, ...]]:
    """Yield a monitor's alarms on a table's rows as they arrive, piece by piece, on the monitor's clock.

    Rows are laid on the clock as in a log, whatever their rate, jitter and loss; a row waits for the few later rows
    that it depends on. In the end the alarms equal those of `watch_log` to the last digit, because the same engine
    reads the same samples. If the motion turns out to be beyond that of identification, alarms of the last tenths of a
    second are reported again. Steps that need the whole log are missing: the self-check, other beginnings, other IMUs,
    the certificate, the verdict. After a gap a fresh stream begins, and its alarms are counted anew. If the monitor
    reads gyros and the whole attitude, the first 24 s determine their installation, and are watched afterwards.

    Parameters
    ----------
    path : str or Path
        A Parquet table in which all channels have the same stamps; not much slower than the monitor.
    monitor : Monitor
        Calibrated before.
    mapping : sequence of str
        As `open_log` takes it.

    Yields
    ------
    tuple of Alarm
        For each piece: new alarms, and alarms with new judgements under the same number.

    Raises
    ------
    InputError
        If the log must be opened as a whole, with the reason, or the monitor has no rate of its own.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> noise = np.random.default_rng(1).standard_normal((6000, 2))
    >>> record = gb.Record(noise @ [[1.0, 1.0], [0.0, 0.1]], channels=["p", "q"], sample_period_s=0.04)
    >>> monitor = gb.calibrate(record.between(0, 120), bank=gb.bank_between(["p"], ["q"]), false_alarms_per_hour=1.0)
    >>> broken = gb.inject(record.between(120, 239), gb.Noise(channel="q", onset_s=180.0, deviation=2.0))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     gb.write_log(broken, Path(folder, "flight.parquet"))
    ...     told = [alarm for piece in gb.watch_live(Path(folder, "flight.parquet"), monitor) for alarm in piece]
    >>> told[0].source, 180.0 < told[0].time_s < 182.0
    ('q', True)
    """
    period_s = monitor.sample_period_s
    if period_s is None or not monitor.channels:
        raise InputError(f"{monitor.name} has no rate, or no channels, of its own; open the log as a whole")
    read = basis_of(monitor).witnesses
    witnesses = (*read, *GYROS, *ATTITUDE) if read else ()
    stream: Stream | None = None
    learner = Learner(period_s, expected_of(monitor)) if has_motion(monitor) else None
    due_s, corrector = 0.0, None
    for chunk in live_chunks(path, period_s, needs=monitor.channels, witnesses=witnesses, mapping=mapping):
        if stream is None or chunk.start_s > due_s + SLACK * period_s:
            if stream is not None and corrector is not None:
                yield _heard(stream, corrector.end())
            stream = monitor.stream()
            corrector = None if learner is None else Corrector(learner)
        due_s = chunk.end_s + period_s
        yield _heard(stream, [chunk] if corrector is None else corrector.push(chunk))
    if stream is not None and corrector is not None:
        yield _heard(stream, corrector.end())


def _heard(stream: Stream, pieces: Sequence[Record]) -> tuple[Alarm, ...]:
    return tuple(alarm for piece in pieces for alarm in stream.push(piece))
