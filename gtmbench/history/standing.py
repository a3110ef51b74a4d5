"""A flight beside those before it: whose constants are others from the first sample on, and what explains that.

A failure moves one constant by any amount: Cauchy's law. Others follow it: an IMU beside a gyro that reads more than
before reads less than that. A healthy cause moves many by what installations differ by, a normal law. All others are as
the earlier flights predict. So a failure of q stands where q's constants alone have changed, or further than another
healthy IMU's would; and a replaced IMU where all of its constants have.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from gtmbench.checks import listed
from gtmbench.detectors.alarm import Judgement
from gtmbench.engine.imus.imu import gyro_and_imu
from gtmbench.history.entry import AT_REST, FACTOR, LAG, MISALIGNMENT, NOISE, OFFSET, Constant, Entry, kind_of
from gtmbench.history.spread import FEWEST, Key, Prediction, predicted
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import Span
from gtmbench.verdict.timeline import Claim, SensorSpan, State, unjudged

_CAUSES = 1.1  # nats: healthy causes are three times as frequent as a sensor that fails from power-on
_SAME = 3.4  # nats: by which it is rarer that an IMU is replaced on the same autopilot
_TURNED_DEG = 5.0  # by which an IMU is mounted otherwise than before
_ALIKE = 0.5  # of the logarithm of noises: what shakes one axis shakes the others by half to twice as much
_TWO = 2.0**0.5  # installations, each of which is one of the population


@dataclass(frozen=True, kw_only=True)
class FlightCause:
    """What may have changed between flights."""

    suspects: tuple[str, ...]  # the sensors of which one failed; none of a healthy cause
    kind: str  # of the fault, as the faults' registry calls it; of a healthy cause, in words
    lead: Key | None = None  # the constant that is off by what a failure is off by
    # by (sensor, name): those that change with it: by how many times as much, and to within which standard deviation
    follow: Mapping[Key, tuple[float, float]] = field(default_factory=dict)
    is_new: bool = False  # whether earlier flights tell nothing of what comes after it
    price: float = 0.0  # in nats

    def log_odds(self, constants: Mapping[Key, Constant], predictions: Mapping[Key, Prediction]) -> float:
        """Return the logarithm of its likelihood over that of a flight whose constants are all as before."""
        off = self._off(constants, predictions)
        total = (0.0 if self.suspects else _CAUSES) - self.price
        if self.lead is not None:
            before = predictions[self.lead]
            width = float(np.hypot(kind_of(self.lead[1]).failure, before.deviation))
            total -= float(np.log(np.pi * width) + np.log1p((off / width) ** 2))  # Cauchy's law
            total -= before.log_density(constants[self.lead].value)
        for key, (share, tolerance) in self.follow.items():
            value, before = constants[key].value, predictions[key]
            total += before.log_density(value - share * off, tolerance) - before.log_density(value)
        return total

    def left(self, key: Key, constants: Mapping[Key, Constant], predictions: Mapping[Key, Prediction]) -> float:
        """Return how likely a constant is beside what this accounts for; what has a tolerance is accounted for."""
        share, tolerance = self.follow.get(key, (0.0, 0.0))
        if key == self.lead or tolerance:
            return 1.0
        return predictions[key].chance(constants[key].value - share * self._off(constants, predictions))

    def _off(self, constants: Mapping[Key, Constant], predictions: Mapping[Key, Prediction]) -> float:
        return 0.0 if self.lead is None else constants[self.lead].value - predictions[self.lead].value


@dataclass(frozen=True, kw_only=True)
class Weighed:
    """An explanation, and how likely it is beside all others."""

    explanation: FlightCause
    probability: float


def weighed(
    constants: Mapping[Key, Constant], predictions: Mapping[Key, Prediction], *, is_same: bool = False
) -> tuple[Weighed, ...]:
    """Return explanations of a flight's constants, by key, beside what earlier flights predict, the likeliest first."""
    shifts = {key: constants[key].value - each.value for key, each in predictions.items()}
    told = list(explanations_of(shifts, is_same=is_same))
    scores = np.array([each.log_odds(constants, predictions) for each in told])
    chances = np.exp(scores - scores.max())
    chances /= chances.sum()
    order = np.argsort(-chances, kind="stable")
    return tuple(Weighed(explanation=told[at], probability=float(chances[at])) for at in order)


def explanations_of(shifts: Mapping[Key, float], *, is_same: bool = False) -> Iterator[FlightCause]:
    """Give what may explain how far some constants are from what they were."""
    yield from _failures(shifts)
    for imu in dict.fromkeys(gyro_and_imu(sensor)[1] for sensor, _ in shifts):
        own = [key for key in shifts if not imu or gyro_and_imu(key[0])[1] == imu]
        others = {key: (0.0, _TWO * kind_of(key[1]).population) for key in own}
        yield FlightCause(
            suspects=(), kind=f"{imu or 'the IMU'} was replaced", follow=others, is_new=True, price=_SAME * is_same
        )
    turned = {key: (0.0, _TURNED_DEG) for key in shifts if key[1].startswith(MISALIGNMENT)}
    if turned:
        yield FlightCause(suspects=(), kind="the IMU was mounted anew", follow=turned, is_new=True)
    noises = sorted((key for key in shifts if key[1] == NOISE), key=lambda key: -abs(shifts[key]))
    if noises:
        alike = dict.fromkeys(noises[1:], (1.0, _ALIKE))
        lags = {key: (0.0, _TWO * kind_of(LAG).population) for key in shifts if key[1] == LAG}
        yield FlightCause(suspects=(), kind="the air or the motors shake it otherwise", lead=noises[0], follow=alike)
        if lags:
            filtered = "its filters or its logging are others"
            yield FlightCause(suspects=(), kind=filtered, lead=noises[0], follow=alike | lags)


def _failures(shifts: Mapping[Key, float]) -> Iterator[FlightCause]:
    """Give failures of each gyro: those of one that is watched move all IMUs beside it back."""
    for sensor in dict.fromkeys(sensor for sensor, _ in shifts):
        gyro, imu = gyro_and_imu(sensor)
        beside = [] if imu else [each for each, name in shifts if name == OFFSET and each.startswith(f"{gyro} of ")]
        scaled = (sensor,) if imu else (sensor, ATTITUDE[GYROS.index(gyro)])  # an angle's factor looks the same
        for suspects, kind, names in (
            ((sensor,), "bias", (OFFSET, AT_REST)),
            ((sensor,), "noise", (NOISE,)),
            (scaled, "scale_factor", (FACTOR,)),
        ):
            own = [(sensor, name) for name in names if (sensor, name) in shifts]
            if own:
                against = [key for each in beside if (key := (each, own[0][1])) in shifts]
                follow = dict.fromkeys(own[1:], (1.0, 0.0)) | dict.fromkeys(against, (-1.0, 0.0))
                if kind == "noise" and (sensor, FACTOR) in shifts:  # its noise stands in what it is fitted to
                    follow |= {(sensor, FACTOR): (0.0, kind_of(FACTOR).failure)}
                yield FlightCause(suspects=suspects, kind=kind, lead=own[0], follow=follow)


CHANCE = 1e-3  # that a healthy flight has any constant which is called another: one flight in a thousand
_SURE = 0.99  # of an accusation, as of every other
_SUSPECTS = 3  # more are none
_SHOWS = 1.645  # deviations above what is called another: what would show in 95 of 100 flights


@dataclass(frozen=True, kw_only=True, eq=False)
class Standing:
    """A flight beside those before it."""

    entry: Entry
    flights: int  # how many of its airframe and its installation were before
    # by (sensor, name): what these say of its constants; none of those that fewer than five tell
    predictions: Mapping[Key, Prediction] = field(default_factory=dict, repr=False)
    is_same: bool = False  # whether the logs say that it was flown with the same autopilot

    @cached_property
    def level(self) -> float:
        """How unlikely a constant has to be: so that of all that tell of failures hardly ever one is by chance."""
        return CHANCE / max(sum(kind_of(name).tells for _, name in self.predictions), 1)

    @cached_property
    def apart(self) -> tuple[Key, ...]:
        """The constants that aren't as before, the unlikeliest first."""
        chances = {key: each.chance(self._value(key)) for key, each in self.predictions.items()}
        return tuple(key for key in sorted(chances, key=chances.__getitem__) if chances[key] < self.level)

    @property
    def telling(self) -> tuple[Key, ...]:
        """Those of them that tell of a failure; that a gyro is quieter doesn't."""
        return tuple(key for key in self.apart if kind_of(key[1]).tells and not self._is_quieter(key))

    @cached_property
    def explained(self) -> tuple[Weighed, ...]:
        """What explains it, the likeliest first; nothing where all is as before."""
        return weighed(self.entry.by_key, self.predictions, is_same=self.is_same) if self.apart else ()

    @property
    def begins(self) -> bool:
        """Whether an installation begins with this flight."""
        return bool(self.explained) and self.explained[0].explanation.is_new and self.explained[0].probability > _SURE

    def entered(self, failed: Sequence[str]) -> Entry:
        """Return the flight as it is entered, beside the sensors that failed in it."""
        apart = {*self.apart} if not self.begins else set()
        apart |= {key for key in self.entry.by_key if key[0] in failed}
        return replace(self.entry, apart=frozenset(apart), begins=self.begins)

    @property
    def lines(self) -> tuple[str, ...]:
        """What is told of the whole flight."""
        if self.flights < FEWEST:
            were = "were" if self.flights != 1 else "was"
            return (
                f"{self.entry.airframe}: {self.flights} of its flights {were} judged before, and it takes {FEWEST} to "
                "tell an error that is there from the first sample on.",
            )
        if not self.predictions:
            return (f"{self.entry.airframe}: this flight tells none of the constants of the {self.flights} before.",)
        if not self.explained:
            return (f"{self.entry.airframe}: {would_show_text(self.predictions, self.level)}.",)
        if self.claims((0.0, 1.0)):
            return ()
        first, is_sure = self.explained[0].explanation, self.explained[0].probability > _SURE
        names = listed([f"the {name} of {sensor}" for sensor, name in self.apart[:_SUSPECTS]])
        are = "is another" if len(self.apart) == 1 else "are others"
        why = first.kind if is_sure and not first.suspects else "what explains that is open"
        return (f"{self.entry.airframe}: {names} {are} than before; {why}.",)

    def _value(self, key: Key) -> float:
        return self.entry.by_key[key].value

    def _is_quieter(self, key: Key) -> bool:
        return key[1] == NOISE and self._value(key) < self.predictions[key].value

    def claims(self, span_s: Span) -> list[Claim]:
        """Return what is claimed of sensors, from the first sample to the last."""
        if not self.telling:
            return []
        likely = self._likely
        suspects = tuple(dict.fromkeys(name for each in likely for name in each.explanation.suspects))
        healthy = [each.explanation.kind for each in likely if not each.explanation.suspects]
        if not suspects:
            return []
        lead = next(each for each in likely if each.explanation.suspects).explanation
        led = lead.lead or self.telling[0]
        reason = reads_text(self.entry.by_key[led], self.predictions[led])
        if healthy or self._unexplained or len(suspects) > _SUSPECTS:
            why = f"{reason}; {'; or '.join(healthy) or 'and nothing explains all of it'}"
            return [(sensor, unjudged(span_s, why)) for sensor in suspects]
        is_one = len(suspects) == 1
        span = SensorSpan(
            start_s=span_s[0],
            end_s=span_s[1],
            state=State.FAILED if is_one else State.SUSPECTED,
            suspects=() if is_one else suspects,
            reason=reason,
            judgement=self._judgement(likely, suspects, span_s),
        )
        return [(sensor, span) for sensor in suspects]

    @cached_property
    def _likely(self) -> tuple[Weighed, ...]:
        """The explanations that are left: together as likely as an accusation has to be."""
        sums = np.cumsum([each.probability for each in self.explained])
        return self.explained[: int(np.searchsorted(sums, _SURE)) + 1]

    @property
    def _unexplained(self) -> tuple[Key, ...]:
        """Those that tell of a failure, or follow one, and that the likeliest explanation doesn't account for."""
        first, own = self.explained[0].explanation, self.entry.by_key
        held = dict.fromkeys([*self.telling, *first.follow])
        return tuple(key for key in held if first.left(key, own, self.predictions) < self.level)

    def _judgement(self, likely: Sequence[Weighed], suspects: tuple[str, ...], span_s: Span) -> Judgement:
        first = likely[0].explanation
        lead = first.lead or self.telling[0]
        name, size, interval = _size(self.entry.by_key[lead], self.predictions[lead])
        sensor = suspects[0] if len(suspects) == 1 else None
        gyro, _, imu = (sensor or "").partition(" of ")
        return Judgement(
            time_s=span_s[1],
            sensor=gyro or None,
            imu=imu,
            candidates=suspects,
            kind=first.kind,
            parameters={name: size, "onset_s": span_s[0]},
            intervals={name: interval},
            probability=min(sum(each.probability for each in likely), 0.999),
            reason="" if sensor else f"{' or '.join(suspects)} explains it",
        )


def _size(constant: Constant, before: Prediction) -> tuple[str, float, tuple[float, float]]:
    """Return the fault's parameter that a constant tells, its size and between which it lies with 95 %."""
    off, reach = constant.value - before.value, before.reach(0.05)
    low, high = off - reach, off + reach
    if constant.name == NOISE:  # what is added to the noise that was there: a root of squares
        usual = np.exp(before.value)
        sizes = [float(usual * np.sqrt(max(np.expm1(2.0 * each), 0.0))) for each in (off, low, high)]
        return "deviation", sizes[0], (sizes[1], sizes[2])
    if constant.kind.unit:
        return "size", off, (low, high)
    middle = before.value
    return "factor", constant.value / middle, ((constant.value - reach) / middle, (constant.value + reach) / middle)


def stood(earlier: Sequence[Entry], entry: Entry) -> Standing:
    """Return a flight beside earlier ones of its airframe, in the order flown, since its installation began."""
    own = installed(earlier, entry)
    is_same = bool(own) and bool(entry.is_on(own[-1]))
    return Standing(entry=entry, flights=len(own), predictions=predicted(own, entry), is_same=is_same)


def installed(earlier: Sequence[Entry], entry: Entry) -> list[Entry]:
    """Return the flights of an entry's airframe since its installation began, but for the entry itself."""
    own = [each for each in earlier if each.airframe == entry.airframe]
    digests = [each.digest for each in own]
    own = own[: digests.index(entry.digest)] if entry.digest in digests else own
    begun = [place for place, each in enumerate(own) if each.begins]
    begun += [place + 1 for place, each in enumerate(own) if each.is_on(entry) is False]  # with another autopilot
    return own[max(begun, default=0) :]


def reads_text(constant: Constant, before: Prediction) -> str:
    """Say by how much a constant is another than before."""
    most = max(before.high - before.value, before.value - before.low)
    flights = f"in {before.flights} flights before"
    off = constant.value - before.value
    if constant.name == NOISE:
        return f"{constant.sensor} is {np.exp(off):.2g} times as noisy throughout; {flights} at most {np.exp(most):.2g}"
    if constant.kind.unit == "deg/s":
        than = "too much" if off > 0.0 else "too little"
        return f"{constant.sensor} reads {abs(off):.2g} deg/s {than} throughout; {flights} at most {most:.2g}"
    if constant.name == FACTOR:
        return (
            f"{constant.sensor} reads {constant.value:.3g} of each turn throughout; {flights} {before.low:.3g} to "
            f"{before.high:.3g}"
        )
    return (
        f"the {constant.name} of {constant.sensor} is {constant.value:.3g} {constant.kind.unit}; {flights} it was not"
    )


def would_show_text(predictions: Mapping[tuple[str, str], Prediction], level: float) -> str:
    """Say that nothing is another than before, and what would have shown."""
    flights = max(each.flights for each in predictions.values())
    told = f"as in {flights} flights before"
    sizes = {}
    for name in (OFFSET, FACTOR):
        own = [
            each.reach(level) + _SHOWS * each.deviation
            for key, each in predictions.items()
            if key[1] == name and " of " not in key[0]
        ]
        if own:
            sizes[name] = max(own)
    parts = [f"an error of {sizes[OFFSET]:.2g} deg/s"] if OFFSET in sizes else []
    parts += [f"a factor of {max(1.0 - sizes[FACTOR], 0.0):.2g}"] if FACTOR in sizes else []
    return f"{told}; {' or '.join(parts)} throughout would show" if parts else told
