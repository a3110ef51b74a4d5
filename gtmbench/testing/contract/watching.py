"""The contract's properties of `watch` and `stream`: in time, causal, repeatable, NaN carried, alike in any chunks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import pairwise

import numpy as np

from gtmbench.detectors.alarm import MISSING, Alarm
from gtmbench.detectors.protocol import Stream
from gtmbench.detectors.tried_faults import WatchedTrials, trials_on
from gtmbench.testing.contract.subject import ContractCase, refused, rows_of, same
from gtmbench.values.record import Record


def detects(case: ContractCase) -> None:
    """Check that it alarms on the fault: without an alarm there is nothing to check."""
    assert case.watch.alarms, "no alarm on the record with a fault; give fault=, one that it detects, or other records"


def in_time(case: ContractCase) -> None:
    """Check that alarms come sorted and numbered from 0, within the record, and that judgements follow them."""
    alarms, record = case.watch.alarms, case.record
    numbers = [alarm.number for alarm in alarms]
    assert numbers == list(range(len(alarms))), f"alarms are numbered {numbers[:5]}; number them 0, 1, 2 ..."
    times = [alarm.time_s for alarm in alarms]
    assert all(np.isfinite(times)), f"alarms at {times[:5]} s"
    assert times == sorted(times), f"alarms at {times[:5]} s aren't sorted"
    slack_s = 1e-3 * record.sample_period_s
    for alarm in alarms:
        assert record.start_s - slack_s <= alarm.time_s <= record.end_s + slack_s, (
            f"an alarm at {alarm.time_s:g} s, outside of the record, {record.start_s:g}..{record.end_s:g} s"
        )
        assert alarm.onset_s <= alarm.time_s + slack_s, f"an onset at {alarm.onset_s:g} s, told at {alarm.time_s:g} s"
        assert 0 <= alarm.fault <= alarm.number, f"alarm {alarm.number} counts to fault {alarm.fault}, a later one"
        judged = [alarm.time_s, *(judgement.time_s for judgement in alarm.judgements)]
        assert judged == sorted(judged), f"the alarm at {judged[0]:g} s is judged at {judged[1:4]} s"
        able = case.monitor.channels if alarm.test == MISSING else case.monitor.suspects
        unknown = {judgement.sensor for judgement in alarm.judgements} - {None, *able}
        assert not unknown, f"it names {', '.join(map(str, unknown))}; its suspects are {case.monitor.suspects}"


def scores_fit(case: ContractCase) -> None:
    """Check that scores stand row for row beside the record, known after their samples, and are the alarms' sources."""
    record, scores = case.record, case.watch.scores
    for name, score in scores.items():
        for what, of in (("values", score.values), ("known_s", score.known_s), ("armed", score.armed)):
            assert np.shape(of) == (len(record),), f"{what} of score '{name}' have shape {np.shape(of)}"
        early = score.exists & (score.known_s < record.time_s - 1e-6)
        assert not early.any(), f"score '{name}' is known before its sample at {record.time_s[early][:1]} s"
        known = score.known_s[score.exists]
        assert not len(known) or known.max() <= record.end_s + 1e-6, (
            f"score '{name}' has values known at {known.max():g} s, after the record's end at {record.end_s:g} s"
        )
    odd = {alarm.source for alarm in case.watch.alarms if alarm.test != MISSING} - set(scores)
    assert not scores or not odd, f"alarms of {', '.join(odd)}, and scores of {', '.join(scores)}"


def trials(case: ContractCase) -> None:
    """Check that trials of a monitor's own say when each fault alone would first alarm, as `watch` does."""
    if not hasattr(case.monitor, "trials"):
        return
    own, watched = trials_on(case.monitor, case.last), WatchedTrials(case.monitor, case.last)
    for fault in case.faults:
        said, wanted = own.detection(fault), watched.detection(fault)
        what = f"of a {fault.kind} of {fault.channel} at {fault.onset_s:g} s trials say"
        assert said.alarm_s == wanted.alarm_s, f"{what} {said.alarm_s}, watching {wanted.alarm_s}"
        assert own.first_alarm_s(fault) == wanted.alarm_s, f"{what} {own.first_alarm_s(fault)} at once"


def untouched(case: ContractCase) -> None:
    """Check that watching leaves the record as it is."""
    before = case.record.values.tobytes()
    case.monitor.watch(case.record)
    assert case.record.values.tobytes() == before, "the record's samples have changed"
    assert not case.record.values.flags.writeable, "the record's samples can be written"


def repeatable(case: ContractCase) -> None:
    """Check that watching twice says the same, whatever was watched between."""
    case.monitor.watch(case.healthy[0])
    same(
        case.told(case.monitor.watch(case.record).alarms), case.told(case.watch.alarms), "the second time", "the first"
    )


def cut(case: ContractCase) -> None:
    """Check that a record that ends earlier has the alarms that the whole has by then: nothing is known beforehand."""
    for count in case.cuts:
        part = rows_of(case.record, 0, count)
        same(
            case.told(case.monitor.watch(part).alarms, part.end_s),
            case.told(case.watch.alarms, part.end_s),
            f"of a record cut at {part.end_s:.2f} s the alarms are",
            "those of the whole by then are",
        )


def later_samples(case: ContractCase) -> None:
    """Check that other samples later change no alarm before, and no score that was known."""
    count = case.cuts[-1] if len(case.cuts) == 1 else case.cuts[-2]
    until_s = case.record.start_s + round((count - 1) * case.record.sample_period_s, 9)
    values = np.array(case.record.values)
    values[count:] = 3.0 * values[count:][::-1] + 1.0
    watch = case.monitor.watch(_with(case.record, values))
    said = f"with other samples after {until_s:.2f} s"
    told = case.told(case.watch.alarms, until_s)
    same(case.told(watch.alarms, until_s), told, f"{said} the alarms by then are", "they were")
    for name, score in case.watch.scores.items():
        known = score.known_s <= until_s + 1e-6
        values_before, values_now = score.values[known], watch.scores[name].values[known]
        odd = ~np.isclose(values_before, values_now, rtol=1e-6, atol=1e-9, equal_nan=True)
        assert not odd.any(), (
            f"{said}, score '{name}' of {case.record.time_s[known][odd][0]:.2f} s, known at "
            f"{score.known_s[known][odd][0]:.2f} s, is {values_now[odd][0]:g} for {values_before[odd][0]:g}"
        )


def missing_samples(case: ContractCase) -> None:
    """Check that missing samples raise no exception and give no times that are none; without samples, no alarm."""
    first = case.cuts[0]
    values = np.array(case.record.values)
    values[max(first - 40, 0) : max(first - 20, 1)] = np.nan
    values[len(values) // 4, 0] = np.nan
    for alarm in case.monitor.watch(_with(case.record, values)).alarms:
        times = alarm.time_s, alarm.onset_s
        assert np.isfinite(times).all(), f"with missing samples, an alarm at {times[0]} s, since {times[1]} s"
    nothing = _with(case.record, np.full(values.shape, np.nan))
    told = case.told(case.monitor.watch(nothing).alarms)
    same(told, [], "of a record without a single sample the alarms are", "they must be")
    begin = rows_of(case.record, 0, 1)
    case.monitor.watch(begin)  # one sample: nothing to say, but no error


def declared_channels(case: ContractCase) -> None:
    """Check that what it declares has to be there, and is enough: alone, it says the same of this fault."""
    if not case.monitor.channels:
        return
    alone = case.monitor.watch(case.record.select(case.monitor.channels))
    told = case.told(case.watch.alarms)
    same(case.told(alone.alarms), told, "with its declared channels alone the alarms are", "with all of them")
    for name in case.monitor.channels:
        without = case.record.select([other for other in case.record.channels if other != name])
        for what, act in (("watch", case.monitor.watch), ("push", case.monitor.stream().push)):
            said = refused(f"{what} of a record without '{name}'", lambda act=act, without=without: act(without))  # type: ignore[misc]
            assert name in said, f"{what} of a record without '{name}' is refused without naming it: {said}"


def sample_period(case: ContractCase) -> None:
    """Check that another sample period than the one it states is refused."""
    if case.monitor.sample_period_s is None:
        return
    other = Record(
        case.record.values[:1000],
        channels=case.record.channels,
        sample_period_s=2.0 * case.monitor.sample_period_s,
        start_s=case.record.start_s,
    )
    for what, act in (("watch", case.monitor.watch), ("push", case.monitor.stream().push)):
        refused(f"{what} of a record sampled every {other.sample_period_s:g} s", lambda act=act: act(other))  # type: ignore[misc]


def _with(record: Record, values: np.ndarray) -> Record:
    return Record(values, channels=record.channels, sample_period_s=record.sample_period_s, start_s=record.start_s)


WATCH: dict[str, Callable[[ContractCase], None]] = {
    "detects": detects,
    "in time": in_time,
    "scores fit": scores_fit,
    "trials": trials,
    "record untouched": untouched,
    "repeatable": repeatable,
    "cut": cut,
    "later samples": later_samples,
    "missing samples": missing_samples,
    "declared channels": declared_channels,
    "sample period": sample_period,
}


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


def _batch(case: ContractCase, kind: str, record: Record | None = None) -> None:
    record = case.record if record is None else record
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


def gaps(case: ContractCase) -> None:
    """Check that a record with missing samples gives the alarms of `watch`."""
    values = np.array(case.record.values)
    first = case.cuts[0]
    values[max(first - 60, 0) : max(first - 45, 1)] = np.nan
    _batch(case, "100", _with(case.record, values))


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


_CHUNKS = {"at once": "all", "by 100": "100", "by 7": "7", "by 1": "1"}
STREAM: dict[str, Callable[[ContractCase], None]] = {
    # a record pushed as one chunk, by 100 samples, and by 7 and 1 around the first alarm gives the alarms of `watch`
    **{f"stream {how}": partial(_batch, kind=kind) for how, kind in _CHUNKS.items()},
    "stream with gaps": gaps,
    "refused chunks": refused_chunks,
    "armed": armed,
}
