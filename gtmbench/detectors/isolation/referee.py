"""Air data as referees between a gyro and the angle that it turns: whose rate is still what air data say it is.

Where a gyro and its virtual sensor from the attitude differ, their difference doesn't tell which of the two is wrong.
Air data and accelerometers tell the rate a third time, and without either (`q_air`, `r_air`; roll has none). Of the
differences of both from it, the one that is as healthy as it was just before the fault clears its sensor.

How good air data are depends on the air: in turbulence they are tens of times noisier than in calm. So what is usual is
learnt on the same flight, and where both differences are worse than usual (a gust, a vane that fails) nothing is said.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gtmbench.channels import axis_of
from gtmbench.detectors.bank.bank import Bank
from gtmbench.detectors.isolation.health import energy
from gtmbench.detectors.statistics.whitening import Whitener, fit_whitener
from gtmbench.method.pseudo_inputs import derived, raw_needs
from gtmbench.record import FloatArray, Record

AIR = {"q": "q_air", "r": "r_air"}  # of the gyros
VANES = ("alpha", "beta", "tas")
_BLOCK_S = 0.2  # of which means are taken: what is faster shows in a sensor's own readings, or is a vane's noise
_ORDER = 5  # blocks that a whitening filter looks back
_LEAST = 60  # blocks to learn from,
_LEAST_JUDGED = 10  # and to judge
_HEALTHY = 1.5  # times the usual mean square
_CHANCE = 3.0  # deviations of what two healthy differences may be apart


@dataclass(frozen=True, kw_only=True, eq=False)
class Referee:
    """What is usual of a gyro's difference from air data, and of its virtual sensor's."""

    gyro: Whitener
    virtual: Whitener

    def against(self, record: Record, output: str, predicted: FloatArray, rows: slice) -> dict[str, float]:
        """Return what speaks against gyro and angle over some rows, of -2 log likelihood; nothing where air data don't.

        Parameters
        ----------
        record : Record
        output : str
            The gyro.
        predicted : shape (rows of the record,)
            Its virtual sensor.
        rows : slice
            That are judged.
        """
        size = _size(record)
        before = min(_ORDER, rows.start // size)
        seen = slice(rows.start - before * size, rows.stop)
        white = [
            whitener.whiten(_blocks(difference[seen], size))[before:]
            for whitener, difference in zip(
                (self.gyro, self.virtual), _differences(record, output, predicted), strict=True
            )
        ]
        there = np.isfinite(white).all(axis=0)
        count = int(there.sum())
        if count < _LEAST_JUDGED:
            return {}
        of_gyro, of_virtual = (energy(each[there]) for each in white)
        if min(of_gyro, of_virtual) > _HEALTHY * count:
            return {}
        apart = abs(of_gyro - of_virtual) - _CHANCE * float(np.sqrt(4.0 * count))
        cleared = [name for name in axis_of(output) if (name == output) == (of_gyro < of_virtual)]
        return dict.fromkeys(cleared, apart) if apart > 0.0 else {}


def referees_of(bank: Bank, record: Record, predicted: Mapping[str, FloatArray]) -> dict[str, Referee]:
    """Learn what is usual from rows before a fault: of gyros that air data tell of, and a bank may confuse with angles.

    Air data that the bank stands on itself tell nothing new.

    Parameters
    ----------
    bank : Bank
    record : Record
        With air data, or without.
    predicted : mapping of output to array of shape (rows,)
        The virtual sensors.
    """
    size, referees = _size(record), {}
    for output in predicted:
        is_open = set(axis_of(output)) <= set(bank.suspects) and not set(VANES) & set(bank.channels)
        if is_open and size and output in AIR and raw_needs(AIR[output]) <= set(record.channels):
            blocks = [_blocks(each, size) for each in _differences(record, output, predicted[output])]
            if all(np.isfinite(each).sum() >= _LEAST for each in blocks):
                gyro, virtual = (fit_whitener([each], order=_ORDER) for each in blocks)
                referees[output] = Referee(gyro=gyro, virtual=virtual)
    return referees


def _differences(record: Record, output: str, predicted: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return gyro - air and virtual sensor - air."""
    (air,) = derived(record, [AIR[output]])
    return record[output] - air, predicted - air


def _size(record: Record) -> int:
    """Return how many rows a block has; none, where a row is longer."""
    return int(_BLOCK_S / record.sample_period_s + 0.5)


def _blocks(values: FloatArray, size: int) -> FloatArray:
    """Return means of rows laid end to end."""
    return np.asarray(values[: len(values) // size * size].reshape(-1, size).mean(axis=1))
