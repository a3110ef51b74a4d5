"""The flights that `real_logs.py` watches; as they are, or misread."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import gtmbench as gb
from gtmbench.intake.contents import log_contents
from gtmbench.log.opening.driven_attitude import FROM_LOG
from gtmbench.log.watch import watch_log
from gtmbench.log.watched_log import WatchedLog
from gtmbench.values.attitude_estimators import DRIVEN
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, GYROS
from recorded.mutations import Mutation

BANK = "C"
CHANNELS = (*GYROS, *ATTITUDE)
FASTEST_HZ = 100.0
AT_REST = 3.0  # deg/s of all gyros together, or a tenth of the usual
SHORTEST_S, PIECE_S = 14.0, 5.5  # of a flight, of a stretch without gaps

Parts = Sequence[gb.Record]  # of a flight, between its gaps


@dataclass(frozen=True)
class LogFile:
    """A log that somebody has."""

    path: Path
    name: str

    @property
    def attitude(self) -> str:
        """Whose attitude to watch its table with: the gyros' where its format documents that, which no table tells."""
        return DRIVEN if log_contents(self.path).attitude_from_gyros else FROM_LOG

    def parts(self) -> Parts:
        """Return the stretches in which it flies: 3 % of the rows that move lie before, 3 % behind.

        What a low-pass takes about a pause of some channels is left out: a table would tell it as a dropout. None where
        it hardly flies. Raises InputError where it can't be opened, or lacks a channel.
        """
        log = gb.open_log(self.path, needs=CHANNELS, witnesses=ACCELEROMETERS)
        if log.sample_period_s < 0.99 / FASTEST_HZ:
            log = gb.open_log(self.path, needs=CHANNELS, witnesses=ACCELEROMETERS, rate_hz=FASTEST_HZ)
        gyros = [record.matrix(GYROS) for record in log.segments]
        middle = np.nanmedian(np.concatenate(gyros), axis=0)
        rates = np.concatenate([np.linalg.norm(values - middle, axis=1) for values in gyros])
        time_s = np.concatenate([record.time_s for record in log.segments])
        moving_s = time_s[rates > max(AT_REST, 0.1 * float(np.nanquantile(rates, 0.9)))]
        if len(moving_s) < 50:
            return []
        first_s, last_s = np.quantile(moving_s, [0.03, 0.97])
        known = [piece for record in log.segments for piece in _known(record)]
        spans = [(record, max(record.start_s, first_s), min(record.end_s, last_s)) for record in known]
        parts = [record.between(start_s, end_s) for record, start_s, end_s in spans if end_s - start_s > PIECE_S]
        return parts if sum(part.end_s - part.start_s for part in parts) > SHORTEST_S else []


def _known(record: gb.Record) -> Iterator[gb.Record]:
    """Yield the stretches of a record in which no channel lacks a sample."""
    known = np.isfinite(record.matrix(CHANNELS)).all(axis=1)
    edges = np.flatnonzero(np.diff(known, prepend=False, append=False))
    for first, stop in edges.reshape(-1, 2):
        yield record.between(record.time_s[first], record.time_s[stop - 1])


def half_s(parts: Parts) -> float:
    """Return the middle of a flight."""
    return 0.5 * (parts[0].start_s + parts[-1].end_s)


def watched(parts: Parts, attitude: str, mutation: Mutation = Mutation()) -> WatchedLog:  # noqa: B008  frozen
    """Return what is said of a flight's second half, identified on its first, with something wrong in all of it.

    `attitude` is what `watch_log` is told of it.
    """
    lines: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "log.csv")
        for part in map(mutation.mutate, parts):
            gb.write_log(part, path)
            header, *rows = path.read_text().splitlines()
            lines += rows if lines else [header, *rows]
        path.write_text("\n".join(lines) + "\n")
        return watch_log(path, BANK, healthy=[(-np.inf, half_s(parts))], attitude=attitude)
