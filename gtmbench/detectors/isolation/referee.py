"""Air data as referees between a gyro and the angle that it turns: which of the two has to be wrong for them to agree.

Where a gyro and the attitude differ, that alone doesn't tell which is wrong. Air data and accelerometers tell pitch and
yaw rate once more (`q_air`, `r_air`), with neither but through gravity, which tells of bank, too. With the virtual
sensor of the one that is wrong in its place, they agree as well as they did just before the fault; so the other one is
cleared.

How good air data are depends on the air: in turbulence they are tens of times noisier than in calm. So what is usual is
learnt on the same flight, and where nothing agrees (a gust, a vane that fails, another fault) nothing is said.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from gtmbench.detectors.bank.bank import Bank
from gtmbench.detectors.isolation.health import energy
from gtmbench.detectors.statistics.whitening import Whitener, fit_whitener
from gtmbench.errors import InputError
from gtmbench.method.pseudo_inputs import derived, raw_needs
from gtmbench.values.channels import axis_of
from gtmbench.values.record import FloatArray, Record

VANES = ("alpha", "beta", "tas")
_AIR = {"p": ("r", "r_air"), "q": ("q", "q_air"), "r": ("r", "r_air")}  # of a gyro: what tells of its axis
_BLOCK_S = 0.2  # of which means are taken: what is faster shows in a sensor's own readings, or is a vane's noise
_ORDER = 5  # blocks that a whitening filter looks back
_LEAST = 10  # blocks judged
_LONGEST_S = 20.0  # judged: an angle that gyros carry on drifts
_HEALTHY = 1.5  # times the usual mean square
_CHANCE = 3.0  # deviations that two healthy ones may be apart


@dataclass(frozen=True, kw_only=True, eq=False)
class Referee:
    """What air data say of a gyro and the angle that it turns."""

    gyro: str
    # by suspect: of the rate's difference from air data, with the suspect's virtual sensor in its place
    usual: Mapping[str, Whitener] = field(repr=False)

    def objections(self, record: Record, virtual: Mapping[str, FloatArray], rows: slice) -> dict[str, float]:
        """Return what speaks against gyro or angle, of -2 log likelihood.

        Nothing where air data agree with neither, or no more than chance tells them apart.

        `virtual`, by suspect, shape (rows of the record,): what they should have read. `rows`: that are judged, the
        first 20 s of them at most.
        """
        size = _size(record)
        before = min(_ORDER, rows.start // size)
        longest = round(_LONGEST_S / record.sample_period_s)
        seen = slice(rows.start - before * size, min(rows.stop, rows.start + longest))
        white = {
            name: self.usual[name].whiten(_blocks(difference[seen], size))[before:]
            for name, difference in _differences(record, self.gyro, virtual)
        }
        there = np.isfinite(list(white.values())).all(axis=0)
        count = int(there.sum())
        energies = {name: energy(each[there]) for name, each in white.items()}
        agreeing, other = sorted(energies, key=energies.__getitem__)
        if count < _LEAST or energies[agreeing] > _HEALTHY * count:
            return {}
        apart = energies[other] - energies[agreeing] - _CHANCE * float(np.sqrt(4.0 * count))
        return {other: apart} if apart > 0.0 else {}


def referees_of(bank: Bank, record: Record, predicted: Mapping[str, FloatArray]) -> dict[str, Referee]:
    """Learn what is usual from rows before a fault, of each gyro that a bank may confuse with its angle.

    Air data that the bank stands on itself tell nothing new.

    `record`: with air data, or without. `predicted`, by output, shape (rows,): the gyros' virtual sensors.
    """
    referees = {}
    for gyro in () if set(VANES) & set(bank.channels) else _AIR:
        is_open = gyro in predicted and set(axis_of(gyro)) <= set(bank.suspects)
        if is_open and _size(record) and raw_needs(_AIR[gyro][1]) <= set(record.channels):
            with suppress(InputError):  # too few rows, or nothing moves
                usual = {
                    name: fit_whitener([_blocks(difference, _size(record))], order=_ORDER)
                    for name, difference in _differences(record, gyro, predicted)
                }
                referees[gyro] = Referee(gyro=gyro, usual=usual)
    return referees


def _differences(record: Record, gyro: str, virtual: Mapping[str, FloatArray]) -> Iterator[tuple[str, FloatArray]]:
    """Give a rate's difference from air data, with virtual sensors in the place of gyro and angle in turn."""
    rate, air = _AIR[gyro]
    needs = raw_needs(air)
    for name in axis_of(gyro):
        stand_in = virtual.get(name, record[name])
        said = derived(record.replace(name, stand_in) if name in needs else record, [air])[0]
        yield name, (stand_in if name == rate else record[rate]) - said


def _size(record: Record) -> int:
    """Return how many rows a block has; none, where a row is longer."""
    return int(_BLOCK_S / record.sample_period_s + 0.5)


def _blocks(values: FloatArray, size: int) -> FloatArray:
    """Return means of rows laid end to end."""
    return np.asarray(values[: len(values) // size * size].reshape(-1, size).mean(axis=1))
