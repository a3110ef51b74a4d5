"""Bank auto for logs: the relations that every one of them allows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gtmbench.checks import naming
from gtmbench.detectors.bank.composed import composed_bank, unwatched
from gtmbench.detectors.bank_detector import BankDetector
from gtmbench.errors import InputError
from gtmbench.intake.contents import log_contents


def bank_for_logs(paths: Sequence[Path], mapping: Sequence[str]) -> tuple[BankDetector, tuple[str, ...]]:
    """Return the bank that logs allow, and which gyros it doesn't watch, and why.

    Its attitude is taken to come from the gyros where any log's format says so.

    Parameters
    ----------
    paths : sequence of Path
        The first is the one that the bank is for.
    mapping : sequence of str
        As `open_log` takes it, for all of them.

    Raises
    ------
    InputError
        Naming a log that can't be read; or the first, where they allow no relation.
    """
    logs = [log_contents(path, mapping=mapping) for path in paths]
    there = [name for name in logs[0].usable if all(name in log.usable for log in logs)]
    with naming(paths[0]):
        if logs[0].no_time:
            raise InputError(logs[0].no_time)
        bank = composed_bank(there, attitude_from_gyros=any(log.attitude_from_gyros for log in logs))
    return BankDetector(bank=bank), unwatched(bank, there)
