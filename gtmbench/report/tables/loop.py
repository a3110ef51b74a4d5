"""What happened in a closed loop, as plain data."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from gtmbench.bench.loop_flight import LoopEvent
from gtmbench.report.words.judgement import loop_text
from gtmbench.values.channels import unit_of


def event_rows(events: Iterable[LoopEvent]) -> list[dict[str, Any]]:
    """Return a row an event; `value` is the channel's, in `unit`."""
    return [{"text": loop_text(event), **asdict(event), "unit": unit_of(event.channel)} for event in events]
