"""How an aircraft answers its commands, over a whole log: which surface failed, or why nobody is named.

Gyros, flow and commands are brought to steps of a twentieth of a second, for an aircraft answers within a block of the
engine, in the longest stretch of a flight in which its wings carry it: on the ground a surface does nothing, so the
beginning and the end of what is fast are left out. That stretch is divided where its answer changes most, all equations
together.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gtmbench.detectors.alarm import Judgement
from gtmbench.detectors.surfaces.commanded import AIRSPEED, Commanded
from gtmbench.detectors.surfaces.equations import Flow
from gtmbench.detectors.surfaces.evidence import AnswerChange, SuspectEvidence, change_of, kind_of, suspects_of
from gtmbench.detectors.surfaces.identification import SETTLES_S, STEP_S, frame_of, in_coloured_noise
from gtmbench.engine.finding import DECISIVE, Finding
from gtmbench.engine.flight import Flight
from gtmbench.engine.named import claims_of
from gtmbench.engine.samples import Samples, edges_of, means_between
from gtmbench.engine.search import BOUND
from gtmbench.errors import InputError
from gtmbench.values.channels import COMMANDS, GYROS, SURFACES, names_of
from gtmbench.values.record import FloatArray, Span, runs
from gtmbench.verdict.timeline import Claim, State, unjudged

_NEEDS = (*GYROS, *COMMANDS, "ny", "nz", "tas", "altitude")  # without an airspeed nobody knows what a surface can do
_FLIES, _FAST = 0.65, 0.75  # of the airspeed that is exceeded in a quarter of the flight: more than when wheels roll
_GROUND_S = 5.0  # beside what is slower
_LEAST_S = 60.0  # of flight: in less nothing is judged
_ENOUGH = round(300.0 / STEP_S)  # steps that tell how late servos and engines are: trying each lag is most of the work
_SLOWEST_S = 0.125  # between samples: an aircraft has answered by then


def commanded_of(flight: Flight, sensors: Mapping[str, Samples]) -> Commanded | None:
    """Return what a flight was commanded; None where a command or an airspeed isn't read, or too little is flown.

    `sensors`, by channel: gyros, commands and what else is read, in the units of channels, on the flight's clock.
    """
    if not {*_NEEDS} <= sensors.keys() or max(sensors[name].step_s for name in (*GYROS, *SURFACES)) > _SLOWEST_S:
        return None
    flow = Flow(vanes={"alpha", "beta"} <= sensors.keys(), forward={"alpha", "beta", "nx"} <= sensors.keys())
    edges = edges_of(flight.blocks)
    fine = np.arange(edges[0], edges[-1] + 0.5 * STEP_S, STEP_S)
    at_s = fine[:-1] + 0.5 * STEP_S
    channels = (*GYROS, *flow.channels, *COMMANDS)
    angles = {
        name: Samples(flight.blocks.time_s, own) for name, own in zip(("phi", "theta"), flight.angles.T, strict=False)
    }
    values = np.column_stack([means_between((angles | dict(sensors))[name], fine) for name in channels])
    flown = np.interp(at_s, flight.blocks.time_s, flight.flown.astype(float)) > 0.5
    there = flown & np.isfinite(values).all(axis=1)
    if not there.any():
        return None
    speed = values[:, channels.index("tas")]
    there &= speed > _FLIES * float(np.quantile(speed[there], _FAST))
    first, last = max(zip(*runs(there), strict=True), key=lambda span: span[1] - span[0])
    beside = round(_GROUND_S / STEP_S)
    part = slice(int(first) + beside, int(last) - beside)
    own = values[part]
    if len(own) * STEP_S < _LEAST_S:
        return None
    try:
        frame = frame_of(flow, [own[:_ENOUGH]], STEP_S)
    except InputError:  # no surface moved
        return None
    return Commanded(start_s=float(fine[part.start]), period_s=STEP_S, channels=channels, values=own, frame=frame)


def framed(commanded: Commanded, until_s: float) -> Commanded:
    """Return the same with the equations as what is there until a time has them."""
    healthy = commanded.until(until_s).values[-_ENOUGH:]
    return replace(commanded, frame=frame_of(commanded.frame.flow, [healthy], commanded.period_s))


_DIVIDED_S = 4.0  # as closely as a flight is divided
BEFORE_S, AFTER_S = 40.0, 10.0  # the least that tells effects, and that shows a change
_CHANCE = 9.2  # of squared deviations: odds of 100 to 1
_RIDGE, _NOTHING = 3.0, 1e-9  # a priori precision; a division's guard


def divided(commanded: Commanded) -> tuple[float, float, float] | None:
    """Return when the effects change most, and between when it may be; None of what is too short."""
    rows, told = round(_DIVIDED_S / STEP_S), np.zeros(0)
    for name, part in commanded.relations.items():
        if name == AIRSPEED:
            continue
        # chunk by chunk [effects, causes]'[effects, causes], white and of one size, and running sums of these
        white = in_coloured_noise([part]).white(part)
        white = white[: len(white) // rows * rows]
        white = white / np.maximum(np.sqrt(np.mean(np.square(white), axis=0)), 1e-12)
        chunks = white.reshape(-1, rows, white.shape[1])
        before = np.cumsum(np.einsum("mki,mkj->mij", chunks, chunks), axis=0)
        whole = _misfit(before[-1])
        # by how much two answers, one before a chunk's end and one behind it, misfit less than one for all; in
        # deviations, summed over the relations
        gained = whole - _misfit(before[:-1]) - _misfit(before[-1] - before[:-1])
        gained = gained * len(white) / np.maximum(whole, _NOTHING)
        told = gained if not len(told) else told[: len(gained)] + gained[: len(told)]
    first, last = round(BEFORE_S / _DIVIDED_S), len(told) - round(AFTER_S / _DIVIDED_S) - 1
    if last <= first:
        return None
    # the division that gains most, and all that chance may have beaten
    near = first + np.flatnonzero(told[first:last] > told[first:last].max() - _CHANCE)
    ends = (first + int(np.argmax(told[first:last])), int(near.min()) - 1, int(near.max()) + 1)
    onset_s, earliest_s, latest_s = (commanded.start_s + SETTLES_S + _DIVIDED_S * (end + 1) for end in ends)
    return onset_s, earliest_s, latest_s


def _misfit(products: FloatArray) -> FloatArray:
    """Return the squares that the best effects leave, by products of causes and, last, of what is explained."""
    inner, mixed = products[..., :-1, :-1], products[..., :-1, -1:]
    whole = inner + _RIDGE * np.eye(inner.shape[-1])
    return np.asarray(products[..., -1, -1] - (mixed * np.linalg.solve(whole, mixed)).sum(axis=(-1, -2)))


_LOOKS_S = 60.0  # behind a change: later others may follow
_MISFIT = 0.1  # of the evidence: what a slightly wrong effect makes
_OF_CHANGE = 0.6  # of all that changed: what is left is another cause's
_MOST = 3  # suspects that are told
_LIVELIER, _CHUNK_S = 1.5, 4.0  # times as much motion, within chunks: effects were told in other motion
_STUCK, _SURE = 0.2, 0.1  # about b = 1, and its deviation: no motion makes an aircraft answer nothing at all
_BESIDE_S = 10.0  # of a change: what gyros or other sensors show by then isn't a surface's
COMPARED = "the answer to its command doesn't change, or not so that it shows"


@dataclass(frozen=True, kw_only=True, eq=False)
class CommandsJudged:
    """What a flight's answer to its commands says."""

    commanded: Commanded = field(repr=False)
    end_s: float  # until when it flies: what failed stays so
    # where the answer changes most; None where too little is flown
    change: AnswerChange | None = field(default=None, repr=False)
    between_s: Span = (0.0, 0.0)  # when that begins, at odds of 100 to 1
    last_s: float = 0.0  # until when it is looked at
    doubt: str = ""  # why nobody is named; "" if somebody is

    @property
    def span_s(self) -> Span:
        """What of the flight is judged."""
        return self.commanded.start_s, self.commanded.end_s

    @property
    def onset_s(self) -> float:
        """When the answer changes most."""
        return self.change.onset_s if self.change else self.span_s[1]

    @property
    def best(self) -> SuspectEvidence | None:
        """Who explains the change best."""
        return self.change.best if self.change else None

    @property
    def named(self) -> str | None:
        """The surface that failed."""
        best = self.best
        return best.suspect.name if best and best.suspect.is_surface and not self.doubt else None

    @property
    def kind(self) -> str | None:
        """How it failed, as far as that shows."""
        return kind_of(self.best.sizes, self.best.deviations) if self.best and self.named else None

    @property
    def surfaces(self) -> tuple[str, ...]:
        """Those whose effect is known."""
        return self.commanded.frame.surfaces

    @property
    def claims(self) -> Iterator[Claim]:
        """What is claimed of the surfaces whose effect is known."""
        for name in self.surfaces:
            if name == self.named:
                yield from claims_of(self._judgement, (name,), (self.onset_s, self.end_s))
            elif self.doubt and name in self.likely:
                yield name, unjudged((self.onset_s, self.span_s[1]), self.doubt)
            yield name, unjudged(self.span_s, COMPARED)

    @property
    def likely(self) -> list[str]:
        """Who may be behind the change: whoever lies within the odds."""
        return [each.suspect.name for each in self.change.likely(DECISIVE, _MISFIT)] if self.change else []

    @property
    def _judgement(self) -> Judgement:
        assert self.change is not None
        assert self.best is not None
        sizes = self.best.sizes
        parameters = {"bias": {"size": -float(sizes[0])}, "scale_factor": {"factor": 1.0 - float(sizes[1])}}
        return Judgement(
            time_s=self.last_s,
            sensor=self.best.suspect.name,
            candidates=(self.best.suspect.name,),
            kind=self.kind,
            parameters=parameters.get(self.kind or "", {}) | {"onset_s": self.onset_s},
            intervals={"onset_s": self.between_s},
        )


def commands_judged(
    flight: Flight, sensors: Mapping[str, Samples], claims: Sequence[Claim], found: Sequence[Finding]
) -> CommandsJudged | None:
    """Return what a flight's answer to its commands says; None where none is known.

    `flight`: without the spans in which gyros or attitude failed. `sensors`, by channel: gyros, commands and all
    others. `claims`: of sensors: where they are clear, no more than stays hidden explains a change. `found`: what
    others found.
    """
    commanded = commanded_of(flight, sensors)
    if commanded is None:
        return None
    at, end_s = divided(commanded), flight.flown_s[1]
    if at is None:
        return CommandsJudged(commanded=commanded, end_s=end_s)
    onset_s, earliest_s, latest_s = at
    last_s = min(latest_s + _LOOKS_S, commanded.end_s)
    split = framed(commanded, earliest_s)
    excluded = dict(_excluded(claims, commanded.channels, (onset_s, last_s)))
    looked_at = split.until(last_s)
    change = change_of(looked_at, [*suspects_of(looked_at, earliest_s, excluded)], earliest_s, [latest_s])
    said = CommandsJudged(
        commanded=split,
        end_s=end_s,
        change=replace(change, onset_s=onset_s),
        between_s=(earliest_s, latest_s),
        last_s=last_s,
    )
    return replace(said, doubt="; ".join(_doubts(said, claims, found)))


def _excluded(claims: Sequence[Claim], channels: Sequence[str], span_s: Span) -> Iterator[tuple[str, float]]:
    """Give the largest error of channels that may hide throughout a span, where they are clear in all of it."""
    for name in channels:
        own = [span for sensor, span in claims if sensor in (name, names_of(name)[-1]) and span.meets(*span_s)]
        clear = [span for span in own if span.state is State.CLEAR and span.sizes is not None]
        covered_s = sum(min(span.end_s, span_s[1]) - max(span.start_s, span_s[0]) for span in clear)
        if covered_s > span_s[1] - span_s[0] - _CHUNK_S:
            yield name, max(span.sizes.error for span in clear if span.sizes is not None)


def _doubts(said: CommandsJudged, claims: Sequence[Claim], found: Sequence[Finding]) -> Iterator[str]:
    change, best = said.change, said.best
    assert change is not None
    assert best is not None
    likely = said.likely
    if min(best.nats, change.nats) < BOUND:
        yield COMPARED
        return
    if len(likely) > 1:
        yield f"its answer changes, and {', '.join(likely[1:_MOST])} or {likely[0]} explains it"
    elif not best.suspect.is_surface:
        yield f"its answer changes, and {best.suspect.name} explains it"
    if best.nats < _OF_CHANGE * change.nats:
        yield "its answer changes more than any surface explains"
    if said.last_s - said.between_s[1] < AFTER_S:
        yield "its answer changes as the flight ends"
    if not (_is_stuck(best) or said.commanded.frame.flow.vanes):
        yield "without vanes only a surface that answers nothing is told from a wrong accelerometer"
    if not _is_stuck(best) and _is_livelier(said):
        yield "it moves more there than before"
    onset_s = said.onset_s
    others = [each.best.suspect for each in found if not each.is_healthy and abs(each.onset_s - onset_s) < _BESIDE_S]
    accused = [
        sensor
        for sensor, span in claims
        if span.state in (State.FAILED, State.SUSPECTED) and span.meets(onset_s - _BESIDE_S, said.span_s[1])
    ]
    if others or accused:
        yield f"{(others + accused)[0]} is off there"


def _is_stuck(best: SuspectEvidence) -> bool:
    return best.suspect.is_surface and abs(best.sizes[1] - 1.0) < _STUCK and best.deviations[1] < _SURE


def _is_livelier(said: CommandsJudged) -> bool:
    """Tell whether a command or a rate moves much more behind a change than before."""
    before, behind = said.commanded.until(said.between_s[0]), said.commanded.since(said.between_s[1]).until(said.last_s)
    rows = said.commanded.rows(_CHUNK_S)

    def moves(values: FloatArray) -> float:
        chunks = values[: len(values) // rows * rows].reshape(-1, rows)
        return float(np.sqrt(np.mean(np.square(chunks - chunks.mean(axis=1, keepdims=True)))))

    names = (*GYROS, *said.commanded.frame.surfaces)
    return any(moves(behind.column(name)) > _LIVELIER * moves(before.column(name)) for name in names)
