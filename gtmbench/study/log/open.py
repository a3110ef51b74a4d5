"""Opening a log for a detector: its channels, or what the log allows instead."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path

from gtmbench.detectors.bank.bank import check_channels
from gtmbench.detectors.protocol import Detector, Monitor
from gtmbench.errors import InputError
from gtmbench.intake.flight_log import FlightLog
from gtmbench.intake.open import LogColumn, log_columns, open_log


def open_for(
    path: str | Path, watcher: Detector | Monitor, *, mapping: Sequence[str] = (), rate_hz: float | None = None
) -> FlightLog:
    """Open a log with the channels that a detector needs; with all of its channels for one that doesn't say.

    Raises
    ------
    InputError
        Where it can't be read, or lacks a channel: saying what looks like it, or which banks the log allows.
    """
    try:
        return open_log(path, mapping=mapping, rate_hz=rate_hz, needs=watcher.channels or None)
    except InputError as error:
        columns: tuple[LogColumn, ...] = ()
        with contextlib.suppress(InputError):
            columns = log_columns(path)
        if columns and not any(column.why_not for column in columns):
            mapped = {text.partition("=")[0].strip() for text in mapping}
            there = mapped | {column.channel for column in columns} | {column.name for column in columns}
            try:
                check_channels(_called(watcher), watcher.channels, there)
            except InputError as lacking:
                raise InputError(f"{path}: {lacking}") from error
        raise


def _called(watcher: Detector | Monitor) -> str:
    return f"bank {watcher.name}" if hasattr(watcher, "bank") else f"'{watcher.name}'"
