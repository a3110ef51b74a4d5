"""The contract over every detector that ships and an outsider's; what breaks it is caught by the right property."""

import random
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.detectors.base import BaseMonitor, FunctionDetector, SimpleDetector
from gtmbench.detectors.buffered_stream import BufferedStream
from gtmbench.detectors.protocol import Watch
from gtmbench.files.shipped import shipped_banks
from gtmbench.testing.contract.subject import contract_case
from gtmbench.testing.contract.suite import CONTRACT, check_detector, check_property
from tests.helpers.monitors import record
from tests.helpers.night import by_day

EXAMPLE = Path(__file__).parents[2] / "docs/how_to/examples/limit_check.py"


def far(record):
    """Alarm where p is beyond 30 deg/s, once a second at most."""
    above = np.flatnonzero(np.abs(record["p"]) > 30.0)
    return record.time_s[above[np.diff(above, prepend=-1000) > 50]][:1]


SHIPPED = ["dissertation", f"{EXAMPLE}:LimitCheck", far, *shipped_banks()]
SLOW = ("B", "leave-one-out")  # to diagnose; the code is that of the other banks, so a property of each sort will do
OF_SLOW = ("detects", "scores fit", "cut", "stream by 7", "stream with gaps", "refused chunks", "saved and loaded")


@cache
def case_of(detector):
    """Banks watch a minute at whose end one fault lies, for diagnosing takes them long; others two of the GTM."""
    if detector not in shipped_banks() or detector == "paper":  # made-up motion of p tells it nothing of r
        return contract_case(detector)
    healthy = [record(6000, seed=seed) for seed in (1, 2, 3)]
    fault = gb.Drift(channel="p", onset_s=46.0, slope=30.0, duration_s=3.0)  # bank B is armed from 42 s on
    return contract_case(detector, [*healthy, record(2750, seed=4)], fault=fault)


def called(part):
    return str(getattr(part, "__name__", part)).rpartition(":")[2]


@pytest.mark.parametrize(
    ("detector", "name"),
    by_day(
        [(detector, name) for detector in SHIPPED for name in (OF_SLOW if detector in SLOW else CONTRACT)], 12, seed=78
    ),
    ids=called,
)
def test_every_detector_keeps_the_contract(detector, name):
    check_property(case_of(detector), name)


def test_the_example_is_small():
    assert len(EXAMPLE.read_text().splitlines()) <= 25


def test_a_monitor_is_checked_without_its_recipe(tmp_path):
    monitor = case_of("dissertation").monitor
    check_detector(monitor)
    gb.save_monitor(monitor, tmp_path / "m.json")
    check_detector(tmp_path / "m.json")


# --- what breaks the contract


@cache
def records():
    """Three short records at 50 Hz."""
    return tuple(record(1500, seed=seed) for seed in (1, 2, 3))


FAULT = [gb.Drift(channel="p", onset_s=at, slope=30.0, duration_s=3.0) for at in (12.0, 22.0)]


def broken(detector):
    """Return the properties that a detector breaks."""
    case = contract_case(detector, records(), fault=FAULT)
    return {name for name in CONTRACT if _breach(case, name)}


def _breach(case, name):
    try:
        check_property(case, name)
    except AssertionError as error:
        return str(error).startswith(f"'{case.monitor.name}', {name}: ")
    return False


@dataclass(frozen=True)
class Limit(SimpleDetector):
    """Holds p against 1.5 times its greatest; nothing is wrong with it."""

    name: str = "limit"
    channels: tuple[str, ...] = ("p", "q")
    factor: float = 1.5
    memory_s: float = 0.0

    def learn(self, records):
        return {"p": self.factor * max(float(np.abs(record["p"]).max()) for record in records)}

    def scores(self, record, learned):
        return {"p": np.abs(record["p"]) / learned["p"]}


@dataclass(frozen=True)
class Average(Limit):
    """Looks at the mean of the last second; nothing is wrong with it."""

    memory_s: float = 1.0

    def scores(self, record, learned):
        padded = np.concatenate([np.full(49, np.nan), record["p"]])
        return {"mean": np.abs(np.lib.stride_tricks.sliding_window_view(padded, 50).mean(axis=1)) / learned["p"] * 2.0}


@dataclass(frozen=True)
class Centred(Limit):
    """Looks half a second ahead, and says so."""

    memory_s: float = 1.0
    look_ahead_s: float = 0.5

    def scores(self, record, learned):
        padded = np.concatenate([np.full(25, np.nan), record["p"], np.full(25, np.nan)])
        return {"mean": np.abs(np.lib.stride_tricks.sliding_window_view(padded, 51).mean(axis=1)) / learned["p"] * 2.0}


@pytest.mark.parametrize("detector", [Limit(), Average(), Centred()], ids=lambda detector: type(detector).__name__)
def test_what_is_right_is_let_through(detector):
    assert broken(detector) == set()


class LooksAhead(Centred):
    """Doesn't say that it looks ahead."""

    look_ahead_s = 0.0

    def __init__(self):
        super().__init__(look_ahead_s=0.0)


class ShortMemory(Average):
    """Says that it looks back less than it does."""

    def __init__(self):
        super().__init__(memory_s=0.3)


class Undeclared(Limit):
    """Watches r, which it doesn't declare."""

    def calibrate(self, records, false_alarms_per_hour=None, *, progress=None):
        if false_alarms_per_hour is not None:
            raise gb.InputError("no")
        return Altered(change=reading_r)


class Learns(Limit):
    """Draws its limit."""

    def learn(self, records):
        return {"p": 10.0 + random.random()}


class Fits:
    """A recipe that calibrate changes."""

    name, channels = "fits", ("p", "q")

    def __init__(self):
        self.fits = 0

    def calibrate(self, records, false_alarms_per_hour=None, *, progress=None):
        if false_alarms_per_hour is not None:
            raise gb.InputError("no")
        self.fits += 1
        return Limit().calibrate(records)


class Divides(Limit):
    """Takes any rate, and fails."""

    def calibrate(self, records, false_alarms_per_hour=None, **_):
        return super().calibrate(records) if false_alarms_per_hour is None else 1 / 0


@dataclass(frozen=True, kw_only=True, eq=False)
class Base(BaseMonitor):
    """A monitor that others break; nothing is wrong with it but that it can't be saved."""

    name: str = "base"
    channels: tuple[str, ...] = ("p", "q")
    memory_s: float = 0.1
    suspects: tuple[str, ...] = ("p",)

    def alarms(self, record):
        record.columns(self.channels)
        high = np.nan_to_num(np.abs(record["p"])) > 25.0
        rows = np.flatnonzero(high & ~np.concatenate([[True], high])[:-1])
        times = record.time_s[rows].tolist()
        return [Alarm(number=i, time_s=at, onset_s=at, source=self.name) for i, at in enumerate(times)]

    def watch(self, record):
        return Watch(monitor=self, record=record, alarms=tuple(self.alarms(record)))


def test_a_base_gives_what_may_be_left_out():
    assert broken(Base()) == set()


@dataclass(frozen=True, kw_only=True, eq=False)
class Altered(Base):
    """A monitor with something done to its alarms."""

    change: Callable

    def alarms(self, record):
        return self.change(record, super().alarms(record))


def misnumbered(_, alarms):
    return [replace(alarm, number=alarm.number + 1, fault=-1) for alarm in alarms]


def unsorted(_, alarms):
    return [replace(alarm, number=i) for i, alarm in enumerate(reversed(alarms))]


def judged(alarm, later_s, sensor):
    said = Judgement(time_s=alarm.time_s + later_s, sensor=sensor, candidates=(sensor,))
    return replace(alarm, judgements=(said,))


def judging_before(_, alarms):
    return [judged(alarm, -1.0, "p") for alarm in alarms]


def accusing_nobodys_suspect(_, alarms):
    return [judged(alarm, 0.0, "r") for alarm in alarms]


def writing(record, alarms):
    record.values.setflags(write=True)
    record.values[:, 0] *= 0.5
    return alarms


def throwing_dice(_, alarms):
    shift = random.random()
    return [replace(alarm, onset_s=alarm.time_s - shift) for alarm in alarms]


def taking_nan_for_large(record, _):
    high = ~(np.abs(record["p"]) <= 25.0)
    rows = np.flatnonzero(high & ~np.concatenate([[False], high])[:-1])
    times = record.time_s[rows].tolist()
    return [Alarm(number=i, time_s=at, onset_s=at, source="base") for i, at in enumerate(times)]


def telling_of_the_future(_, alarms):
    return [replace(alarm, time_s=alarm.time_s + 30.0) for alarm in alarms]


def reading_r(record, alarms):
    record["r"]
    return alarms


def hearing_nothing(*_):
    return []


class KeyErrors(Base):
    """Refuses a record without its channels in Python's words."""

    def alarms(self, record):
        if "q" not in record:
            raise KeyError("q")
        return super().alarms(record)


class AnyPeriod(Base):
    """States a sample period, and takes any."""

    sample_period_s = 0.02


@dataclass(kw_only=True, eq=False)
class Thawed(BaseMonitor):
    """Can be changed."""

    name: str = "thawed"
    channels: tuple[str, ...] = ("p", "q")
    memory_s: float = 0.1

    def watch(self, record):
        return replace(Base(name=self.name, suspects=()).watch(record), monitor=self)


class Rounds(Limit):
    """Restores a little less than it saved."""

    def restore(self, figures, provenance=None):
        learned = {name: round(value, 1) for name, value in figures["learned"].items()}
        return super().restore({**figures, "learned": learned}, provenance or {})


@dataclass(frozen=True, kw_only=True, eq=False)
class Streamed(Base):
    """A monitor with a stream of its own."""

    made: type[BufferedStream]

    def stream(self):
        return self.made(self)


class Twice(BufferedStream):
    def push(self, chunk):
        super().push(chunk)
        return self.alarms


class Unarmed(BufferedStream):
    @property
    def armed(self):
        return {}


class Eager(BufferedStream):
    """Begins anew where it refuses."""

    def push(self, chunk):
        try:
            return super().push(chunk)
        except gb.InputError:
            self.__init__(self._monitor)
            raise


def unpicklable():
    return FunctionDetector(lambda record: Base().alarms(record)[0].time_s if Base().alarms(record) else [], name="f")


BROKEN = {
    "looks ahead": (LooksAhead(), {"cut", "later samples"}),
    "says too short a memory": (ShortMemory(), {"stream by 7", "stream by 1"}),
    "reads what it doesn't declare": (Undeclared(), {"declared channels"}),
    "draws its limits": (Learns(), {"calibrated again"}),
    "changes its recipe": (Fits(), {"calibrated again"}),
    "takes a rate and fails": (Divides(), {"rate"}),
    "numbers from 1": (Altered(change=misnumbered), {"in time"}),
    "doesn't sort": (Altered(change=unsorted), {"in time"}),
    "judges before its alarm": (Altered(change=judging_before), {"in time"}),
    "names whom it doesn't suspect": (Altered(change=accusing_nobodys_suspect), {"in time"}),
    "writes into the record": (Altered(change=writing), {"record untouched"}),
    "throws dice": (Altered(change=throwing_dice), {"repeatable"}),
    "forgets NaN": (Altered(change=taking_nan_for_large), {"missing samples"}),
    "tells of the future": (Altered(change=telling_of_the_future), {"in time"}),
    "raises a KeyError": (KeyErrors(), {"declared channels"}),
    "takes any sample period": (AnyPeriod(), {"sample period"}),
    "hears nothing": (Altered(change=hearing_nothing), {"detects"}),
    "can be changed": (Thawed(), {"frozen"}),
    "rounds its file": (Rounds(), {"saved and loaded"}),
    "can't be pickled": (unpicklable(), {"frozen"}),
    "tells twice": (Streamed(made=Twice), {"stream by 100"}),
    "is never armed": (Streamed(made=Unarmed), {"armed"}),
    "forgets what it refuses": (Streamed(made=Eager), {"refused chunks"}),
}


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_broken_is_caught_by_its_property(name):
    detector, properties = BROKEN[name]
    breaches = broken(detector)
    assert properties <= breaches
    assert next(breach for breach in CONTRACT if breach in breaches) in properties  # that check_detector names
