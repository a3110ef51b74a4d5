"""Which surface failed on a flight, and why nobody is named where nobody can be."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gtmbench.detectors.alarm import Judgement
from gtmbench.detectors.surfaces.commanded import Commanded
from gtmbench.detectors.surfaces.evidence import AnswerChange, SuspectEvidence, change_of, kind_of, suspects_of
from gtmbench.engine.commands.commanded import commanded_of, framed
from gtmbench.engine.commands.divided import AFTER_S, divided
from gtmbench.engine.finding import DECISIVE, Finding
from gtmbench.engine.flight import Flight
from gtmbench.engine.named import claims_of
from gtmbench.engine.samples import Samples
from gtmbench.engine.search import BOUND
from gtmbench.values.channels import GYROS, names_of
from gtmbench.values.record import FloatArray, Span
from gtmbench.verdict.timeline import Claim, State, unjudged

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
