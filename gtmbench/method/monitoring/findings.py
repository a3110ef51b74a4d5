"""What a diagnosis says: judgements of an alarm as time goes on, and the finding they add up to."""

from __future__ import annotations

from dataclasses import dataclass, field

from gtmbench.method.monitoring.virtual import ANGLES


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """What an alarm looked like at one time.

    Attributes
    ----------
    time_s : float
        When it could be said.
    sensor : str or None
        The one suspect whose fault explains the alarm decisively better than any other's; None while undecided.
    candidates : tuple of str
        Whose fault may explain it, the likeliest first; empty where nothing is left to explain.
    kind : str or None
        The kind of fault that explains it, of `sensor` or the likeliest candidate; None where none does.
    parameters, errors : dict
        Its parameters and their standard errors, in the channel's unit (per second for slopes).
    kind_margin : float
        By how much BIC the next kind of the same sensor is worse.
    """

    time_s: float
    sensor: str | None
    candidates: tuple[str, ...]
    kind: str | None
    parameters: dict[str, float]
    errors: dict[str, float]
    kind_margin: float


@dataclass(frozen=True, kw_only=True)
class Finding:
    """An alarm and what became of it.

    Attributes
    ----------
    alarm_s : float
        When the alarm could be raised.
    onset_s : float
        When the change began, as far as the alarm's test tells.
    residual, series : str
        Whose residual rose first, and which test of it.
    judgements : tuple of Judgement
        In time: by the signature alone, with the alarm, then one a horizon; the last is what is known at the end.
    ended_s : float or None
        When the fault had gone; None while it lasts, or where the record doesn't tell.
    resumed_s : float or None
        When that was known, so that watching goes on; None while it isn't.
    """

    alarm_s: float
    onset_s: float
    residual: str
    series: str
    judgements: tuple[Judgement, ...] = field(repr=False)
    ended_s: float | None
    resumed_s: float | None

    @property
    def last(self) -> Judgement:
        """What is known at the end; of a fault that ended, what was decided while it lasted."""
        decided = [one for one in self.judgements if one.sensor is not None]
        return decided[-1] if decided and self.ended_s is not None else self.judgements[-1]

    @property
    def sensor(self) -> str | None:
        """The sensor that failed, or None while undecided."""
        return self.last.sensor

    @property
    def isolated_s(self) -> float | None:
        """When the decision on the sensor was possible that the end confirms; None while undecided."""
        if self.sensor is None:
            return None
        time_s = self.last.time_s
        for judgement in reversed([one for one in self.judgements if one.time_s <= time_s]):
            if judgement.sensor != self.sensor:
                break
            time_s = judgement.time_s
        return time_s

    def at(self, after_alarm_s: float) -> Judgement:
        """Return the last judgement up to so many seconds after the alarm; the first, if there is none."""
        due_s = self.alarm_s + after_alarm_s + 1e-6
        return [self.judgements[0], *(one for one in self.judgements if one.time_s <= due_s)][-1]

    @property
    def verdict(self) -> str:
        """Say it in words: ``p failed``, ``reference attitude failed (psi)``, ``undecided: p or phi``."""
        if self.sensor is not None:
            return f"reference attitude failed ({self.sensor})" if self.sensor in ANGLES else f"{self.sensor} failed"
        if not self.last.candidates:
            return "passed: nothing is left to explain"
        if set(self.last.candidates) <= set(ANGLES):
            return f"reference attitude failed ({' or '.join(self.last.candidates)})"
        return f"undecided: {' or '.join(self.last.candidates)}"
