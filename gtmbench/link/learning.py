"""A monitor learnt from a link's first span, exactly as `gtmbench monitor` learns one from a log's.

What arrives is kept as a small log, and that goes through a log's own stages: the self-check, the choice of what is
fit to learn from, the bank that the channels allow, its calibration.
"""

from __future__ import annotations

import tempfile
from collections import deque
from collections.abc import Sequence
from pathlib import Path

from gtmbench.detectors.bank.composed import AUTO
from gtmbench.detectors.protocol import Monitor, is_ready
from gtmbench.errors import InputError
from gtmbench.jobs.progress import silent
from gtmbench.link.closing import why_not
from gtmbench.link.packets import SavedLink
from gtmbench.link.telemetry import Message
from gtmbench.log.learning.healthy_part import chosen
from gtmbench.log.learning.learnt_monitor import learnt
from gtmbench.log.opening.driven_attitude import FROM_LOG
from gtmbench.log.opening.opened_log import opened
from gtmbench.log.opening.question import asked
from gtmbench.verdict.timeline import Claim

_MOST = 2_000_000  # packets or lines


class Lesson:
    """The span of a link that a monitor is learnt from."""

    def __init__(
        self,
        learn_s: float,
        *,
        is_table: bool,
        mapping: Sequence[str] = (),
        system: int | None = None,
        attitude: str = FROM_LOG,
    ) -> None:
        self._learn_s, self._is_table, self._mapping = learn_s, is_table, tuple(mapping)
        self.system, self._attitude = system, attitude
        self._header = b""
        self._parts: deque[tuple[float, bytes]] = deque(maxlen=_MOST)
        self._first_s: float | None = None
        self._newest_s = 0.0

    @property
    def time_s(self) -> float | None:
        """The newest stamp."""
        return None if self._first_s is None else self._newest_s

    def take(self, arrived_s: float, parts: Sequence[bytes], messages: Sequence[Message]) -> bool:
        """Keep what arrived; tell whether it is enough."""
        for part in parts:
            if self._is_table and not self._header:
                self._header = part
            else:
                self._parts.append((arrived_s, part))
        for message in messages:
            if self._first_s is None or not -2.0 <= message.time_s - self._newest_s <= self._learn_s:
                self._first_s = self._newest_s = message.time_s
            self._newest_s = max(self._newest_s, message.time_s)
        return self._first_s is not None and self._newest_s - self._first_s >= self._learn_s

    def learnt(self) -> tuple[Monitor | None, str]:
        """Return the monitor and what it was learnt from, or none and why not; half of the span is kept then."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "link.csv" if self._is_table else "link.tlog")
            self._write(path)
            log = path if self.system is None or self._is_table else Path(f"{path}:{self.system}")
            try:
                question = asked(
                    log,
                    AUTO,
                    healthy=[(-float("inf"), float("inf"))],
                    mapping=self._mapping,
                    rate_hz=None,
                    false_alarms_per_hour=None,
                    attitude=self._attitude,
                )
                link = opened(question)
                if link.judged is not None and link.judged.accused:
                    self._forget()
                    return None, _accused_text(link.judged.accused)
                taught = learnt(chosen(link), silent)
            except InputError as error:
                self._forget()
                return None, why_not(error, path)
        if not (taught.check.passed and is_ready(taught.monitor)):
            self._forget()
            return None, "; ".join([*map(str, taught.check.stops), *map(str, taught.check.doubts)]) or "it is no flight"
        (start_s, end_s), *_ = taught.identified_s or ((0.0, 0.0),)
        return taught.monitor, f"learnt from {end_s - start_s:.0f} s"

    def _write(self, path: Path) -> None:
        with SavedLink(path, is_table=self._is_table) as saved:
            for arrived_s, part in [(0.0, self._header)] * self._is_table + [*self._parts]:
                saved.put(arrived_s, part)

    def _forget(self) -> None:
        for _ in range(len(self._parts) // 2):
            self._parts.popleft()
        if self._first_s is not None:
            self._first_s += 0.5 * (self._newest_s - self._first_s)


def _accused_text(accused: Sequence[Claim]) -> str:
    """Say whom the engine accuses in what a monitor would be learnt from."""
    who = list(dict.fromkeys(sensor for sensor, _ in accused))
    since_s = min(span.start_s for _, span in accused)
    return f"{', '.join(who)} {'failed' if len(who) == 1 else 'may have failed'} since {since_s:.0f} s"
