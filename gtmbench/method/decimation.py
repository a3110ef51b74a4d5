"""Decimation: fewer samples a second, for operators that are slow beside the sample rate."""

from __future__ import annotations

import numpy as np

from gtmbench.checks import whole
from gtmbench.errors import InputError
from gtmbench.record import Record, check_record

_HALF = 13  # half of the filter's length, in samples of the result
_CUTOFF = 0.8  # of the new Nyquist frequency
_KAISER = 7.86  # beta of a ripple of 1e-4


def decimate(record: Record, factor: int) -> Record:
    """Return every `factor`-th sample of all channels, low-pass filtered before.

    The filter (Kaiser, 26 factor + 1 taps, zero phase) is flat within 1e-4 up to 60 % of the new Nyquist frequency and
    leaves less than 1e-4 of what lies above it. It is the same for every channel, so the operator between them stays
    the same. Only complete results are kept: 13 new samples go at either end. A missing sample makes those missing that
    need it, and no others.

    Parameters
    ----------
    record : Record
    factor : int
        1 leaves the record as it is.

    Raises
    ------
    InputError
        Where the factor isn't a whole number of 1 or more, or the record is too short.

    Examples
    --------
    >>> record = Record(np.ones(1001), channels=["p"], sample_period_s=0.01)
    >>> decimate(record, 10)
    Record(75 samples, 1.3..8.7 s, every 0.1 s: p)
    """
    check_record(record)
    factor = whole("factor", factor, 1)
    if factor == 1:
        return record
    from scipy.signal import firwin, upfirdn

    half = _HALF * factor
    if len(record) < 2 * half + 1:
        raise InputError(
            f"{len(record)} samples are too few to keep one in {factor}: the filter takes {2 * half + 1}; choose a "
            "smaller factor or a longer record"
        )
    taps = firwin(2 * half + 1, _CUTOFF / factor, window=("kaiser", _KAISER))
    # result m stands at sample m factor - half and is complete from m = 2 half / factor on
    kept = slice(2 * _HALF, (len(record) - 1) // factor + 1)
    columns = [upfirdn(taps / taps.sum(), channel, down=factor)[kept] for channel in record.values.T]
    return Record(
        np.column_stack(columns),
        channels=record.channels,
        sample_period_s=record.sample_period_s * factor,
        start_s=record.start_s + round(half * record.sample_period_s, 9),
    )
