"""The contract's properties of `stream`: the alarms of `watch`, with the samples that make them known."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import pairwise

import numpy as np

from gtmbench.detectors.alarm import MISSING, Alarm
from gtmbench.detectors.protocol import Stream
from gtmbench.testing.contract.subject import ContractCase, refused, rows_of, same
from gtmbench.values.record import Record


def _cut(case: ContractCase, kind: str) -> list[int]:
    """Return where the chunks begin and end: all at once, by 100, and by 7 and 1 around the first alarm."""
    count = len(case.record)
    if kind == "1":
        near = case.cuts[0]
        inner = [*range(max(near - 40, 1), min(near + 60, count))]
    elif kind == "7":
        near = case.cuts[0]
        inner = [*range(max(near - 350, 1), min(near + 700, count), 7)]
    else:
        inner = [*range(100, count, 100)] if kind == "100" else []
    return [0, *inner, count]


def _pushed(stream: Stream, record: Record, edges: Sequence[int], kind: str) -> None:
    """Push a record in chunks; fail where an alarm doesn't come with the samples that make it known."""
    slack_s = 1e-3 * record.sample_period_s
    before_s, numbers = -np.inf, 0
    held: dict[int, Alarm] = {}
    for begin, end in pairwise(edges):
        chunk = rows_of(record, begin, end)
        for alarm in stream.push(chunk):
            old = held.get(alarm.number)
            held[alarm.number] = alarm
            if old is not None:
                assert alarm != old, f"in chunks of {kind}, the alarm of {alarm.time_s:.3f} s came twice"
                continue
            assert alarm.number == numbers, f"in chunks of {kind}, alarm {alarm.number} came after {numbers} others"
            numbers += 1
            assert before_s - slack_s < alarm.time_s <= chunk.end_s + slack_s, (
                f"in chunks of {kind}, the alarm of {alarm.time_s:.3f} s came with the samples of "
                f"{chunk.start_s:.3f}..{chunk.end_s:.3f} s"
            )
        before_s = chunk.end_s
    assert len(stream.alarms) == numbers, f"the stream holds {len(stream.alarms)} alarms and has given {numbers}"


def _batch(case: ContractCase, record: Record, kind: str) -> None:
    stream = case.monitor.stream()
    _pushed(stream, record, _cut(case, kind), kind)
    watch = case.watch if record is case.record else case.monitor.watch(record)
    what = f"in chunks of {kind} the stream's"
    same(case.told(stream.alarms), case.told(watch.alarms), f"{what} alarms are", "those of watch are")
    same(_ends(stream.alarms), _ends(watch.alarms), f"{what} faults are", "those of watch are")


def _ends(alarms: Iterable[Alarm]) -> list[str]:
    """Return to which faults alarms count, and when these ended."""
    known = [(alarm.fault, alarm.ended_s, alarm.end_known_s) for alarm in alarms]
    return [f"{fault}: {[None if at is None else round(at, 6) for at in ends]}" for fault, *ends in known]


def all_at_once(case: ContractCase) -> None:
    """Check that a record pushed as one chunk gives the alarms of `watch`."""
    _batch(case, case.record, "all")


def hundreds(case: ContractCase) -> None:
    """Check that chunks of 100 samples give the alarms of `watch`."""
    _batch(case, case.record, "100")


def sevens(case: ContractCase) -> None:
    """Check that chunks of 7 samples, around the first alarm, give the alarms of `watch`."""
    _batch(case, case.record, "7")


def singles(case: ContractCase) -> None:
    """Check that single samples, around the first alarm, give the alarms of `watch`, each when it becomes known."""
    _batch(case, case.record, "1")


def gaps(case: ContractCase) -> None:
    """Check that a record with missing samples gives the alarms of `watch`."""
    values = np.array(case.record.values)
    first = case.cuts[0]
    values[max(first - 60, 0) : max(first - 45, 1)] = np.nan
    record = Record(
        values,
        channels=case.record.channels,
        sample_period_s=case.record.sample_period_s,
        start_s=case.record.start_s,
    )
    _batch(case, record, "100")


def refused_chunks(case: ContractCase) -> None:
    """Check that a chunk that is refused changes nothing."""
    stream, half = case.monitor.stream(), max(case.cuts[0] - 5, 1)
    stream.push(rows_of(case.record, 0, half))
    for what, chunk in _wrong(case, half):
        refused(f"a chunk that {what}", lambda chunk=chunk: stream.push(chunk))  # type: ignore[misc]
    stream.push(rows_of(case.record, half, half))  # no samples are no error
    stream.push(rows_of(case.record, half, len(case.record)))
    told = case.told(case.watch.alarms)
    same(case.told(stream.alarms), told, "after refused chunks the stream's alarms are", "those of watch are")


def _wrong(case: ContractCase, half: int) -> Iterator[tuple[str, Record]]:
    record = case.record
    yield "comes after a gap", rows_of(record, half + 1, half + 50)
    yield "comes again", rows_of(record, half - 1, half + 50)
    right = rows_of(record, half, half + 50)
    period_s = 2.0 * record.sample_period_s
    yield (
        "has another sample period",
        Record(right.values, channels=right.channels, sample_period_s=period_s, start_s=right.start_s),
    )
    names = case.monitor.channels or record.channels
    yield f"lacks '{names[-1]}'", right.select([name for name in record.channels if name != names[-1]])


def armed(case: ContractCase) -> None:
    """Check that `armed` says of each score whether it could raise an alarm: just before one, it could."""
    stream = case.monitor.stream()
    stream.push(rows_of(case.record, 0, case.cuts[0]))
    said = stream.armed
    odd = {name: value for name, value in said.items() if not isinstance(value, bool)}
    assert not odd, f"armed holds {odd}; it must be true or false, by score"
    source, test = case.watch.alarms[0].source, case.watch.alarms[0].test
    assert test == MISSING or said.get(source), f"just before an alarm of '{source}', armed is {dict(said)}"


STREAM: dict[str, Callable[[ContractCase], None]] = {
    "stream at once": all_at_once,
    "stream by 100": hundreds,
    "stream by 7": sevens,
    "stream by 1": singles,
    "stream with gaps": gaps,
    "refused chunks": refused_chunks,
    "armed": armed,
}
