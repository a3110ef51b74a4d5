"""The recipe of bank auto: which bank it is depends on what it is given to calibrate on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from gtmbench.detectors.bank.composed import AUTO, composed_bank
from gtmbench.detectors.bank_detector import BankDetector, BankMonitor, restore_bank
from gtmbench.jobs.progress import Progress, silent
from gtmbench.method.problem import as_records
from gtmbench.values.record import Record


@dataclass(frozen=True, kw_only=True)
class AutoDetector:
    """Bank auto as a recipe: a log's or a record's channels make it a bank (`composed_bank`)."""

    name: str = AUTO
    channels: tuple[str, ...] = ()  # whatever is there

    def calibrate(
        self, records: Sequence[Record], false_alarms_per_hour: float | None = None, *, progress: Progress = silent
    ) -> BankMonitor:
        """Identify the bank that the channels of all records allow, and set its thresholds."""
        given = as_records(records)
        first, *others = (set(record.channels) for record in given)
        bank = composed_bank(first.intersection(*others))
        return BankDetector(bank=bank).calibrate(given, false_alarms_per_hour, progress=progress)

    def restore(self, figures: Mapping[str, Any], provenance: Mapping[str, Any] = MappingProxyType({})) -> BankMonitor:
        """Return the monitor of some figures, whichever bank it was."""
        return restore_bank(figures, provenance)
