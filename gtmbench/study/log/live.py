"""A log watched as a live source would send it: alarms as they come, nothing of it kept."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from gtmbench.channels import ATTITUDE, GYROS
from gtmbench.clock import SLACK
from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.basis import basis_of
from gtmbench.detectors.installing import Corrector, Learner, expected_of, has_motion
from gtmbench.detectors.protocol import Monitor, Stream
from gtmbench.errors import InputError
from gtmbench.intake.live import live_chunks
from gtmbench.record import Record


def watch_live(path: str | Path, monitor: Monitor, *, mapping: Sequence[str] = ()) -> Iterator[tuple[Alarm, ...]]:
    """Give what a monitor says of a table's rows as they come in, on the monitor's clock: a piece after the other.

    Rows are laid on it as a log's are, whatever their rate, jitter and loss; one waits for the few behind it that it
    depends on. Alarms are those of `watch_log`, in the end to the last digit: the same engine hears the same samples,
    and where the motion turns out to be beyond what was identified, what was said in the tenths of a second before is
    said anew. What looks at a log as a whole isn't there: the self-check, other beginnings, other IMUs, the
    certificate, the verdict. After a gap a fresh stream begins, and its alarms are counted anew. Where the monitor
    hears gyros and the whole attitude, the first 24 s settle how they are installed, and are heard then.

    Parameters
    ----------
    path : str or Path
        A Parquet table, all channels with the same stamps; not much slower than the monitor.
    monitor : Monitor
        Calibrated before.
    mapping : sequence of str
        As `open_log` takes it.

    Yields
    ------
    tuple of Alarm
        Of each piece: those that are new, and those of which more is known, by the same number.

    Raises
    ------
    InputError
        If the log has to be opened as a whole, saying why; where the monitor has no rate of its own.

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
