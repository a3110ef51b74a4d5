"""Plans of a calibration: which healthy stretches identify, which are judged, and what is allowed for beyond them.

Of much flight some identifies and the rest is judged. Of little every sample counts: each stretch is judged by
operators that haven't seen it, and the monitor's own stand on all of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from gtmbench.detectors.bank.bank import Bank
from gtmbench.errors import InputError
from gtmbench.record import Record

_FIRST = 0.4  # of one record: identifies
_SHORTEST = 20  # samples
_FOLDS = 5  # stretches of one or two records; of more, each record is one
_MOST_FOLDS = 10
_NOISE_DEVIATIONS = 4.0  # of a window's mean square: chance
_NOISE_POWER = 2.0  # by which the noise of another stretch may be stronger
_MARGIN = 2.0  # on thresholds of energies: mostly the model's error, which other motion may well double
_BASELINES = 5.0  # in the shortest record
_SHORTEST_S = 5.0
_LOOKS = 20.0  # so many times what an operator looks back and ahead, at least
_A_COEFFICIENT = 50  # samples that one of a whitening filter stands on

Rows = tuple[int, slice]  # of a judged record, by its number
Fold = tuple[Sequence[Record], Sequence[Rows]]  # to identify on, and what these operators judge


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """What differs between calibrations.

    Attributes
    ----------
    bank : Bank
        With the statistic that its thresholds are set for.
    learn : sequence of Record
        That the monitor's operators and whitening filters stand on.
    judged : sequence of Record
        That its thresholds stand on.
    folds : sequence of Fold
        Which operators judge which rows; those of `learn` itself are the monitor's own.
    order : int
        Of the whitening filters.
    deviations, power, margin : float
        What isn't held against a healthy residual: so many deviations of a window's mean square; so much of it; and a
        factor on thresholds.
    """

    bank: Bank
    learn: Sequence[Record] = field(repr=False)
    judged: Sequence[Record] = field(repr=False)
    folds: Sequence[Fold] = field(repr=False)
    order: int
    deviations: float = 0.0
    power: float = 1.0
    margin: float = 1.0


def divided(records: Sequence[Record], bank: Bank) -> Plan:
    """Return a plan for much flight: every third record identifies, or the first 40 % of one; the rest is judged."""
    if len(records) == 1:
        only = records[0]
        if len(only) < _SHORTEST:
            raise InputError(f"a record of {len(only)} samples is too short to calibrate on; give minutes")
        cut_s = only.start_s + _FIRST * (only.end_s - only.start_s)
        learn, judged = [only.between(only.start_s, cut_s)], [only.between(cut_s, only.end_s)]
    else:
        learn, judged = list(records[::3]), [record for i, record in enumerate(records) if i % 3]
    everything = [(number, slice(len(record))) for number, record in enumerate(judged)]
    order = round(bank.whitening_s / records[0].sample_period_s)
    return Plan(bank=bank, learn=learn, judged=judged, folds=[(learn, everything)], order=order)


def left_out(records: Sequence[Record], bank: Bank) -> Plan:
    """Return a plan for little flight: every stretch is left out in turn.

    Too little energy doesn't alarm, means are compared with those of the last fifth of a record, and the noise may be
    twice as strong as seen: a short record doesn't tell how steady it is.

    Raises
    ------
    InputError
        Where the records are too short.
    """
    period_s, samples = records[0].sample_period_s, sum(map(len, records))
    shortest_s = min(map(len, records)) * period_s
    if shortest_s < _SHORTEST_S:
        raise InputError(
            f"a healthy record of {shortest_s:.3g} s is too short to calibrate on; give at least {_SHORTEST_S:g} s, "
            "better minutes"
        )
    _check_length(bank, samples * period_s)
    baseline_s = min(bank.statistic.baseline_s, shortest_s / _BASELINES)
    return Plan(
        bank=replace(bank, statistic=replace(bank.statistic, baseline_s=baseline_s, two_sided=False)),
        learn=records,
        judged=records,
        folds=list(_folds(records)),
        order=min(round(bank.whitening_s / period_s), samples // _A_COEFFICIENT),
        deviations=_NOISE_DEVIATIONS,
        power=_NOISE_POWER,
        margin=_MARGIN if bank.statistic.name == "energy" else 1.0,
    )


def _folds(records: Sequence[Record]) -> Iterator[Fold]:
    pieces: list[Rows] = []
    for number, record in enumerate(records):
        edges = np.linspace(0, len(record), (1 if len(records) > 2 else _FOLDS) + 1).astype(int).tolist()
        pieces += [(number, slice(first, stop)) for first, stop in pairwise(edges)]
    for first in range(min(len(pieces), _MOST_FOLDS)):
        held = pieces[first::_MOST_FOLDS]
        yield [_part(records[number], rows) for number, rows in pieces if (number, rows) not in held], held


def _part(record: Record, rows: slice) -> Record:
    return record.between(record.time_s[rows.start], record.time_s[rows.stop - 1])


def _check_length(bank: Bank, total_s: float) -> None:
    """Refuse to identify operators that look over much of what there is: they would fit it, and nothing else."""
    for spec in bank.residuals:
        least_s = _LOOKS * (spec.look_back_s + spec.look_ahead_s)
        if total_s < least_s:
            raise InputError(
                f"{total_s:.3g} s of healthy records are too few for the residual of {spec.output}, which looks over "
                f"{spec.look_back_s + spec.look_ahead_s:g} s; give at least {least_s:g} s, or look back and ahead less"
            )
