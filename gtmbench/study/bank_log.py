"""Opening a log for a bank: its channels, or what the log allows instead."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path

from gtmbench.detectors.bank.bank import Bank
from gtmbench.errors import InputError
from gtmbench.intake.flight_log import FlightLog
from gtmbench.intake.open import LogColumn, log_columns, open_log


def open_for_bank(
    path: str | Path, bank: Bank, *, mapping: Sequence[str] = (), rate_hz: float | None = None
) -> FlightLog:
    """Open a log with the channels that a bank needs.

    Raises
    ------
    InputError
        Where it can't be read, or lacks a channel: saying what looks like it, or which banks the log allows.
    """
    try:
        return open_log(path, mapping=mapping, rate_hz=rate_hz, needs=bank.channels)
    except InputError as error:
        columns: tuple[LogColumn, ...] = ()
        with contextlib.suppress(InputError):
            columns = log_columns(path)
        if columns and not any(one.why_not for one in columns):
            mapped = {text.partition("=")[0].strip() for text in mapping}
            try:
                bank.check_channels(mapped | {one.channel for one in columns} | {one.name for one in columns})
            except InputError as lacking:
                raise InputError(f"{path}: {lacking}") from error
        raise
