"""The search for the strongest explanation: which window, which onset, which end."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gtmbench.engine.evidence import Support, axes_of, axis_number, evidence
from gtmbench.engine.finding import DECISIVE, Finding
from gtmbench.engine.imus.imu import gyro_and_imu
from gtmbench.engine.model import Model
from gtmbench.engine.restless import Place, restless_sums
from gtmbench.engine.sums import WindowSums
from gtmbench.values.record import BoolArray, FloatArray, IntArray

EXPECTED = 6.0  # nats: the most that chance makes of evidence on a log as the model has it
BOUND = 16.0  # nats, tempered: the least of a finding
_ONLY_TWO = 2.0  # chosen: a heading that drifted was 11.8 nats behind r where 11.3 are allowed; 29 other faults stay
MISFIT = 0.05  # of the evidence: what a slightly wrong shape makes
FIRST_S = 4.0  # of a log before an onset
WINDOWS_S = (5.0, 10.0, 20.0, 60.0)  # of what ends: as short as a gyro fails, as long as is promised
_SHORTEST_S = 5.0  # to the end of the log
_KNOWN = 0.4  # of a window's blocks
_ONSETS = 150  # at most, of windows to the log's end
_TRIES = 12  # windows
_CALM, _STILL_CALM = 0.5, 0.7  # of the bound, where means are as restless as they are there
_ENDS = 6.0  # nats: a fault that ends is rarer than one that stays
_ENDS_TRIED = 30  # by when it shows, to a tenth of the time
_NEAR_S = 12.0  # about an onset that is dated again
_SHAPE = 0.1  # of a size behind an estimator: it is none of three of the first order
_TOLD, _LEAST_CHANCE = 5, 0.001  # explanations and equations that are told
_MORE = 0.5  # of the bound, for each earlier finding


@dataclass(frozen=True, kw_only=True, eq=False)
class Scan:
    """All windows of a model, looked at once, whatever is asked of them."""

    model: Model

    @cached_property
    def windows(self) -> tuple[IntArray, IntArray]:
        """Onsets and ends of all windows that are looked at, in cells."""
        cell_s, cells = self.model.cell_s, self.model.cells
        first = max(round(FIRST_S / cell_s), 1)
        pairs = set()
        for width in (max(round(width_s / cell_s), 3) for width_s in WINDOWS_S):
            pairs |= {(a, a + width) for a in range(first, cells - width + 1, max(round(width / 3), 1))}
        latest = cells - max(round(_SHORTEST_S / cell_s), 3)
        if latest >= first:
            step = max((latest - first) // _ONSETS, 1)
            pairs |= {
                (a, cells) for a in {*range(first, latest + 1, step), *range(max(latest - 20, first), latest + 1)}
            }
        onset, last = np.array(sorted(pairs), dtype=np.int64).reshape(-1, 2).T
        known = self.model.known_share(onset, last) >= _KNOWN
        return onset[known], last[known]

    @cached_property
    def seen(self) -> Support:
        """The evidence of all windows."""
        return evidence(self.model, *self.windows)

    @cached_property
    def left(self) -> FloatArray:
        """The ratio of all windows, by parts where it is more than chance makes."""
        seen = self.seen
        ratio = seen.ratio.copy()
        loud = np.flatnonzero(ratio.max(axis=1, initial=-np.inf) > EXPECTED)
        if len(loud):
            ratio[loud] = evidence(self.model, seen.onset[loud], seen.last[loud], by_parts=True).ratio
        return ratio


@dataclass(frozen=True, kw_only=True, eq=False)
class WindowSearch:
    """A search in a model."""

    scan: Scan
    # shape (explanations,): what evidence is divided by: chance makes more of some explanations on this log than noise
    # would
    tempers: FloatArray
    found: tuple[Finding, ...] = ()  # what is known of already, and taken away in the model

    @property
    def model(self) -> Model:
        """What it searches."""
        return self.scan.model

    def strongest(self, bound: float) -> Finding | None:
        """Return the strongest finding that withstands its own restlessness; None where none exceeds a bound."""
        seen = self.scan.seen
        above = seen.ratio / self.tempers > self._bounds(seen.onset, seen.last, bound)
        totals = np.where(above, seen.total / self.tempers, -np.inf)
        for _ in range(_TRIES):
            if not np.isfinite(totals.max(initial=-np.inf)):
                return None
            window, place = (int(each) for each in np.unravel_index(int(np.argmax(totals)), totals.shape))
            onset, last = int(seen.onset[window]), int(seen.last[window])
            at = Place(onset=onset, last=last, explanation=place, size=float(seen.size[window, place]))
            found = self._withstands(at, bound)
            if found is not None:
                return found
            shared = np.minimum(seen.last, last) - np.maximum(seen.onset, onset)
            whole = np.maximum(seen.last, last) - np.minimum(seen.onset, onset)
            alike = (shared > 0.5 * whole) & (np.argmax(totals, axis=1) == place)
            alike[window] = True
            totals[alike] = -np.inf
        return None

    def again(self, finding: Finding, bound: float) -> Finding | None:
        """Return a finding as it is with all others taken away; None where it no longer stands."""
        place = self.model.signatures.place_of(finding.best)
        return self._described(finding.first, finding.last, place, bound)

    def _withstands(self, at: Place, bound: float) -> Finding | None:
        calm = self._one(at.onset, at.last, restless_sums(self.model, at))
        if calm.ratio[0, at.explanation] / self.tempers[at.explanation] <= _CALM * bound:
            return None
        first, last, place = self._placed(at)
        return self._described(first, last, place, bound)

    def _one(self, onset: int, last: int, sums: tuple[WindowSums, ...] | None = None) -> Support:
        return evidence(self.model, np.array([onset]), np.array([last]), sums, by_parts=True)

    @cached_property
    def _suspects(self) -> NDArray[np.str_]:
        return np.array([each.suspect for each in self.model.explanations])

    @cached_property
    def _are_gains(self) -> BoolArray:
        return np.array([each.is_gain for each in self.model.explanations], dtype=bool)

    @cached_property
    def _are_of_turns(self) -> BoolArray:
        return np.array([each.of_turns for each in self.model.explanations], dtype=bool)

    @cached_property
    def _imus(self) -> NDArray[np.str_]:
        return np.array([gyro_and_imu(suspect)[1] for suspect in self._suspects])

    def _bounds(self, onset: IntArray, last: IntArray, bound: float) -> FloatArray:
        """Return what evidence has to exceed in windows: more where an earlier finding may be a bit wrong."""
        found = np.full((len(onset), len(self.model.explanations)), bound * (1.0 + _MORE * len(self.found)))
        axes = axes_of(self.model)
        for each in self.found:
            meets = (np.minimum(each.last, last) > np.maximum(each.first, onset))[:, np.newaxis]
            own = axes == axis_number(each.best.suspect)
            if each.is_frozen:
                own = own & (self._imus == gyro_and_imu(each.best.suspect)[1])
                found = np.where(meets & own, np.inf, found)
            elif each.parts_imus:  # what its shape leaves between two IMUs is large beside their noise
                found = np.where(meets & own, np.inf, found)
            elif axis_number(each.best.suspect) < 0:  # it isn't off twice at a time
                found = np.where(meets & (self._suspects == each.best.suspect), np.inf, found)
            elif each.best.fades_s:  # behind an estimator it bends the other axes
                found = found + meets * 2.0 * MISFIT * each.evidence
            # a share of what is read and one of what is turned: together they explain noise
            if each.best.is_gain and not each.is_frozen:
                apart = self._are_of_turns != each.best.of_turns
                found = np.where(meets & own & apart & self._are_gains, np.inf, found)
        return found

    def _allowed(self, onset: int, last: int) -> BoolArray:
        return np.asarray(np.isfinite(self._bounds(np.array([onset]), np.array([last]), 1.0)[0]))

    def _placed(self, at: Place) -> tuple[int, int, int]:
        """Return onset, end and explanation that fit the whole log best; one temper for all, or the least would win."""
        cells, temper = self.model.cells, float(self.tempers[at.explanation])
        allowed, best = self._allowed(at.onset, at.last), None
        for end in dict.fromkeys((cells, at.last)):
            onsets = self._onsets(end)
            if not len(onsets):
                continue
            seen = evidence(self.model, onsets, np.full_like(onsets, end))
            totals = np.where(allowed, seen.total / temper, -np.inf)
            row, own = np.unravel_index(int(np.argmax(totals)), totals.shape)
            worth = float(totals[row, own]) - (_ENDS if end < cells else 0.0)
            if best is None or worth > best[0]:
                best = (worth, int(onsets[row]), end, int(own))
        if best is None:
            return at.onset, at.last, at.explanation
        _, first, last, place = best
        if last < cells:
            last = self._end(first, last, place, temper)
        return first, last, place

    def _onsets(self, last: int) -> IntArray:
        first = max(round(FIRST_S / self.model.cell_s), 1)
        latest = last - 2
        return np.arange(first, latest + 1, max((latest - first) // (2 * _ONSETS), 1), dtype=np.int64)

    def _end(self, first: int, last: int, place: int, temper: float) -> int:
        """Return the end that fits best."""
        cells = self.model.cells
        near = np.arange(first + 3, min(last + 30, cells) + 1)
        ends = np.unique(np.concatenate([near, np.linspace(last, cells, 40).astype(np.int64)]))
        totals = evidence(self.model, np.full_like(ends, first), ends).total[:, place] / temper
        totals = totals + np.where(ends >= cells, _ENDS, 0.0)
        return int(ends[int(np.argmax(totals))]) if np.isfinite(totals).any() else last

    def _described(self, first: int, last: int, place: int, bound: float) -> Finding | None:
        """Return a finding, dated and ranked with means as restless as they are there."""
        model, temper = self.model, float(self.tempers[place])
        allowed = self._allowed(first, last)
        known = self._one(first, last)
        is_around = (model.cells - last) * model.cell_s > 5.0
        sums = restless_sums(
            model,
            Place(onset=first, last=last, explanation=place, size=float(known.size[0, place])),
            is_around=is_around,
        )
        calm = self._one(first, last, sums).ratio[0] / self.tempers
        if np.max(np.where(allowed, calm, -np.inf)) < _STILL_CALM * bound:
            return None
        near = max(round(_NEAR_S / model.cell_s), 2)
        earliest = max(round(FIRST_S / model.cell_s), 1)
        onsets = np.arange(max(first - near, earliest), min(first + near, last - 2) + 1)
        if not len(onsets):
            return None
        seen = evidence(model, onsets, np.full_like(onsets, last), sums)
        totals = np.where(allowed, seen.total / temper, -np.inf)
        best = totals.max(axis=0)
        place = int(np.argmax(best))
        row = int(np.argmax(totals[:, place]))
        own = self._one(int(onsets[row]), last, sums)
        if not own.ratio[0, place] / self.tempers[place] >= bound:
            return None
        margin = DECISIVE + MISFIT * float(best[place])
        least = best[place] - margin * self._alike(place)
        order = [int(each) for each in np.argsort(-best) if best[each] > least[each]]
        found = self._finding(own, seen, onsets, totals, order, margin, last)
        shows = self._shows(int(onsets[row]), last, place, found.size, sums)
        return replace(found, shows_s=model.flight.blocks.start_s + shows * model.cell_s)

    def _alike(self, place: int) -> FloatArray:
        """Return how much less likely than one explanation each other may be, times the usual, and still be left.

        Nobody but r holds a heading, and nobody but a heading r; whether the gyros drive it is assumed. How an error of
        either begins is all that tells them apart, and least known.
        """
        own = self._suspects[place]
        is_twin = np.isin(self._suspects, ("r", "psi")) & (self._suspects != own)
        is_open = own in ("r", "psi") and self.model.flight.is_assumed
        return np.where(is_twin, _ONLY_TWO, 1.0) if is_open else np.ones(len(self._suspects))

    def _shows(self, first: int, last: int, place: int, size: float, sums: tuple[WindowSums, ...]) -> int:
        """Return the first end, in cells, up to which it shows: by s^2 / (2 d^2), d the deviation of its size s.

        The ratio itself doesn't tell: it is by the constants of all outside a window, where the fault goes on.
        """
        ends = np.unique(first + np.geomspace(min(3, last - first), last - first, _ENDS_TRIED).astype(np.int64))
        seen = evidence(self.model, np.full_like(ends, first), ends, sums)
        needed = BOUND * self.tempers[place] + float(self.model.of_explanations("price")[place])
        shown = np.flatnonzero(0.5 * np.square(size / seen.deviation[:, place]) >= needed)
        return int(ends[shown[0]]) if len(shown) else last

    def _finding(
        self,
        one: Support,
        seen: Support,
        onsets: IntArray,
        totals: FloatArray,
        order: list[int],
        margin: float,
        last: int,
    ) -> Finding:
        model, place = self.model, order[0]
        row = int(np.argmax(totals[:, place]))
        best, cell_s = float(totals[row, place]), model.cell_s
        start_s, explanations = model.flight.blocks.start_s, model.explanations
        # onsets that are as likely as the best to within the margin: the range is theirs
        near = onsets[totals[:, place] > best - margin]
        own = explanations[place]
        # the size may be that of any explanation of the same sensor and kind, at any such onset
        alike = [
            each for each in order if (explanations[each].suspect, explanations[each].kind) == (own.suspect, own.kind)
        ]
        sizes = [float(size) for each in alike for size in seen.size[totals[:, each] > best - margin, each]]
        # a tempered likelihood has deviations larger by its root; how an estimator fades is known to a share of the
        # size
        deviation = float(seen.deviation[row, place] * np.sqrt(self.tempers[place]))
        deviation += _SHAPE * abs(float(seen.size[row, place])) * bool(own.fades_s)
        first = int(onsets[row])
        return Finding(
            first=first,
            last=last,
            onset_s=start_s + (first + 1) * cell_s,  # a cell is left out behind it
            end_s=start_s + min(last * cell_s, len(model.flight) * model.flight.blocks.period_s),
            onset_range_s=(start_s + float(near.min()) * cell_s, start_s + float(near.max() + 2) * cell_s),
            ranked=tuple((explanations[each], float(best - totals[:, each].max())) for each in order),
            size=float(seen.size[row, place]),
            interval=(min(sizes) - 2.0 * deviation, max(sizes) + 2.0 * deviation),
            evidence=float(one.ratio[0, place] / self.tempers[place]),
            own_axis=self._own_axis(one, place),
            shown=float(np.maximum(one.by_equation[~model.is_witness, 0, place], 0.0).sum()),
            lasts=last >= model.cells,
            chances=self._chances(totals.max(axis=0), margin),
            shown_by=self._shown_by(one, place),
        )

    def _chances(self, best: FloatArray, margin: float) -> tuple[tuple[str, str, float], ...]:
        """Return how likely explanations are, the likeliest first: what lies a margin behind has odds of 1 to 100."""
        odds = np.exp((best - best.max()) * DECISIVE / margin)
        sums: dict[tuple[str, str], float] = {}
        for each, share in zip(self.model.explanations, odds / odds.sum(), strict=True):
            key = each.suspect, each.kind
            sums[key] = sums.get(key, 0.0) + float(share)
        likeliest = sorted(sums.items(), key=lambda told: -told[1])[:_TOLD]
        return tuple((*key, chance) for key, chance in likeliest if chance >= _LEAST_CHANCE)

    def _shown_by(self, one: Support, place: int) -> tuple[tuple[str, int, float], ...]:
        """Return the equations that show it most, with what each shows in nats, the strongest first."""
        nats = one.by_equation[:, 0, place]
        told = [
            (each.equation.relation.name, each.equation.channel, float(shown))
            for each, shown in zip(self.model.products, nats, strict=True)
            if shown > DECISIVE
        ]
        return tuple(sorted(told, key=lambda each: -each[2])[:_TOLD])

    def _own_axis(self, one: Support, place: int) -> float:
        """Return what the suspect's own axis of gyro and attitude shows, in nats; all of them of what has no axis."""
        axis = int(axes_of(self.model)[place])
        shown = 0.0
        for equation, each in zip(self.model.products, one.by_equation[:, 0, place], strict=True):
            if equation.equation.relation.is_of_axes and axis in (-1, equation.equation.channel):
                shown += float(each)
        return shown
