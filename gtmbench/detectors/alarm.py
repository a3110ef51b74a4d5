"""What a detector says: an alarm, and the judgements of it as time goes on."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

from gtmbench.detectors.virtual import ANGLES

MISSING = "missing"  # the test of an alarm that tells of a channel's samples, not of a score
OUTSIDE = "outside"  # of one that tells of a score where motion is beyond what the monitor knows
NOISE_CHANGED = "the noise changed"  # a doubt: sensors that became louder or quieter are no fault by themselves
MOST_PROBABLE = 0.999  # that a judgement is right: what nobody thought of stays possible
TIMES_LOUDER = 3.0  # than the noise that was learnt: from there on it is a fault


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """The diagnosis of an alarm at one time. It uses nothing after `time_s`.

    Attributes
    ----------
    time_s : float
        When it was possible, in seconds.
    sensor : str or None
        The one suspect whose fault explains the alarm decisively better than any other's; None while undecided.
    candidates : tuple of str
        Sensors whose fault may explain it, the likeliest first; empty if nothing is left to explain.
    kind : str or None
        The kind of fault that explains it, of `sensor` or the likeliest candidate; None if none does.
    parameters : dict
        Its parameters, by the names and in the units of the kind's class; `value`, what a sensor that is stuck reads,
        in the channel's; `onset_s`, when the fault began.
    intervals : dict of name to (float, float)
        Between which each parameter lies with a probability of 95 %, where the record tells it; one end is 0 or
        infinite where only a bound is known.
    probability : float or None
        That the fault is of `sensor`, or while undecided of one of `candidates`; None where nobody has calibrated that.
    kind_probability : float or None
        That `kind` is right if `sensor` is.
    partner : str or None
        The other sensor of a fault that mixes two: they are swapped, or one is turned towards the other.
    reason : str
        Why no sensor is named; empty if one is, or nothing is left to explain.
    doubt : str
        What may have raised the alarm although no sensor failed; empty if a sensor must have failed.
    imu : str
        The IMU of `sensor`, if a log has several.
    axis : str
        The channel of `sensor` that is wrong, of a sensor of several, where one alone is; empty otherwise.
    together : tuple of Judgement
        Of each sensor, where several have failed at once; `sensor` is None then, and all are `candidates`.

    Examples
    --------
    >>> import gtmbench as gb
    >>> early = gb.Judgement(time_s=12.5, sensor=None, candidates=("p", "phi"), reason="both explain it")
    >>> late = gb.Judgement(time_s=20.0, sensor="p", candidates=("p",), kind="bias", parameters={"size": 2.1})
    >>> early.verdict, late.verdict
    ('undecided: p or phi', 'p failed')
    """

    time_s: float
    sensor: str | None
    candidates: tuple[str, ...]
    kind: str | None = None
    parameters: dict[str, float] = field(default_factory=dict)
    intervals: dict[str, tuple[float, float]] = field(default_factory=dict)
    probability: float | None = None
    kind_probability: float | None = None
    partner: str | None = None
    reason: str = ""
    doubt: str = ""
    imu: str = ""
    axis: str = ""
    together: tuple[Judgement, ...] = ()

    @property
    def swapped(self) -> bool:
        """Whether `sensor` and `partner` are swapped."""
        return self.kind == "swap" and None not in (self.sensor, self.partner)

    @property
    def failed(self) -> tuple[str, ...]:
        """The sensors that have failed: two that are swapped, or all that failed at once; none while undecided."""
        if self.together:
            return self.candidates
        return tuple(name for name in (self.sensor, self.partner if self.swapped else None) if name is not None)

    @property
    def verdict(self) -> str:
        """In words: ``p failed``, ``p and q have changed places``, ``p, q and r failed``, ``undecided: p or phi``."""
        if self.swapped:
            return f"{self.sensor} and {self.partner} have changed places"
        if self.together:
            return f"{', '.join(self.candidates[:-1])} and {self.candidates[-1]} failed"
        if self.sensor is not None:
            named = f"{self.sensor} ({self.axis})" if self.axis else self.sensor
            return f"{named} of {self.imu} failed" if self.imu else f"{named} failed"
        if self.doubt:
            return f"can't tell: {self.doubt}"
        return f"undecided: {' or '.join(self.candidates)}" if self.candidates else "nothing is left to explain"

    def naming_nobody(self, why: str) -> Judgement:
        """Return it as one that accuses nobody, and why; what it says by its own residual is its reason."""
        return replace(self, sensor=None, partner=None, doubt=why, reason=f"{self.verdict} by its own residual")


@dataclass(frozen=True, kw_only=True)
class Alarm:
    """A test statistic that rose above its threshold, or a channel with missing samples, and its judgements.

    The alarm and its time depend on nothing after `time_s`. Later judgements are added to it: a stream then returns the
    same alarm again, with the same `number`.

    Attributes
    ----------
    number : int
        The alarm's number in its record, from 0, in the order of `time_s`.
    time_s : float
        When it could be raised, look-ahead and windows included.
    onset_s : float
        The estimated start of the change; `time_s` if the test gives none.
    source : str
        The name of the test statistic that rose, or of the channel with missing samples.
    test : str
        The test that rose; empty if there is only one; `missing` for missing samples.
    judgements : tuple of Judgement
        In order of time. Empty for a detector without isolation, and while the alarm belongs to an earlier alarm's
        fault.
    fault : int
        The number of the first alarm of the same fault, as far as is known; otherwise its own.
    ended_s : float or None
        When the fault ended; None while it lasts, or if its end can't be determined.
    ended_between_s : (float, float) or None
        Between which times that is with a probability of 95 %.
    end_known_s : float or None
        When the end was known, from which watching goes on; None before that.
    looks_again_s : float or None
        When it is judged again, as far as is known; until then its last judgement stands. None once it is decided, its
        fault has ended or all looks are over, and of a detector that looks once.

    Examples
    --------
    >>> import gtmbench as gb
    >>> named = gb.Judgement(time_s=12.9, sensor="p", candidates=("p",), kind="bias")
    >>> alarm = gb.Alarm(number=0, time_s=12.4, onset_s=12.0, source="p", judgements=(named,))
    >>> alarm.verdict, alarm.sensor, alarm.isolated_s
    ('p failed', 'p', 12.9)
    """

    number: int
    time_s: float
    onset_s: float
    source: str
    test: str = ""
    judgements: tuple[Judgement, ...] = field(default=(), repr=False)
    fault: int = -1
    ended_s: float | None = None
    ended_between_s: tuple[float, float] | None = None
    end_known_s: float | None = None
    looks_again_s: float | None = None

    def __post_init__(self) -> None:
        if self.fault < 0:
            object.__setattr__(self, "fault", self.number)

    def disbelieved(self, why: str) -> Alarm:
        """Return it as one that never accuses anybody, and why; what is doubted of its own stays so."""
        judged = (each.naming_nobody(why) if each.candidates and not each.doubt else each for each in self.judgements)
        return replace(self, judgements=tuple(judged))

    @property
    def is_first(self) -> bool:
        """Whether it is the first alarm of its fault."""
        return self.fault == self.number

    @property
    def last(self) -> Judgement | None:
        """The final judgement; for a fault that ended, the one made while it lasted. None without any."""
        decided = [judged for judged in self.judgements if judged.failed]
        if decided and self.ended_s is not None:
            lasting = [judged for judged in decided if judged.time_s <= self.ended_s]
            return (lasting or decided)[-1]
        return self.judgements[-1] if self.judgements else None

    @property
    def sensor(self) -> str | None:
        """The sensor that failed, or None while undecided."""
        return None if self.last is None else self.last.sensor

    @property
    def candidates(self) -> tuple[str, ...]:
        """The sensors whose fault may explain it; empty if nothing is left to explain or nothing was judged."""
        return () if self.last is None else self.last.candidates

    @property
    def has_passed(self) -> bool:
        """Whether it was judged and nothing is left to explain."""
        return self.last is not None and not self.last.candidates

    @property
    def doubt(self) -> str:
        """What may have raised it although no sensor failed; empty if a sensor must have failed."""
        return "" if self.last is None else self.last.doubt

    @property
    def accuses(self) -> bool:
        """Whether a sensor must have failed: nothing else may have raised it, and something is left to explain."""
        return not (self.doubt or self.has_passed)

    @property
    def is_of_several(self) -> bool:
        """Whether several sensors failed at once: all of `candidates`, not one of them."""
        return self.last is not None and bool(self.last.together)

    @property
    def isolated_s(self) -> float | None:
        """When the final decision on the sensor first became possible; None while undecided."""
        if self.last is None or not self.last.failed:
            return None
        time_s = self.last.time_s
        for judgement in reversed([judged for judged in self.judgements if judged.time_s <= time_s]):
            if {*judgement.failed} != {*self.last.failed}:
                break
            time_s = judgement.time_s
        return time_s

    def at(self, after_alarm_s: float) -> Judgement | None:
        """Return the last judgement up to this many seconds after the alarm, or the first if there is none by then."""
        due_s = self.time_s + after_alarm_s + 1e-6
        by_then = [judged for judged in self.judgements if judged.time_s <= due_s] or list(self.judgements[:1])
        return by_then[-1] if by_then else None

    @property
    def verdict(self) -> str:
        """In words: ``p failed``, ``reference attitude failed (psi)``, ``undecided: p or phi``, ``alarm``."""
        if self.last is None:
            return "alarm"
        names = self.last.candidates if self.last.sensor is None else (self.last.sensor,)
        if self.last.together:
            return self.last.verdict
        if not names:
            return f"passed: {self.last.verdict}"
        if set(names) <= set(ANGLES) and not self.last.swapped and not self.last.doubt:
            return f"reference attitude failed ({' or '.join(names)})"
        return self.last.verdict


ALARM_COLUMNS = ("alarm (s)", "onset (s)", "of", "said")  # what `rows_of_alarms` says, column by column


def rows_of_alarms(alarms: Iterable[Alarm]) -> list[tuple[str, str, str, str]]:
    """Return what is said of each alarm as words, a row each, for a notebook.

    >>> rows_of_alarms([Alarm(number=0, time_s=2.5, onset_s=2.0, source="p")])
    [('2.50', '2.00', 'p', 'alarm')]
    """
    return [(f"{alarm.time_s:.2f}", f"{alarm.onset_s:.2f}", alarm.source, alarm.verdict) for alarm in alarms]


def alarms_at(rises: Iterable[tuple[float, str]], first: int = 0) -> tuple[Alarm, ...]:
    """Return alarms of times and names of scores that tell no onset, numbered from `first` on.

    >>> [(alarm.number, alarm.onset_s) for alarm in alarms_at([(1.5, "p"), (2.0, "q")], first=3)]
    [(3, 1.5), (4, 2.0)]
    """
    return tuple(
        Alarm(number=number, time_s=time_s, onset_s=time_s, source=source)
        for number, (time_s, source) in enumerate(rises, first)
    )
