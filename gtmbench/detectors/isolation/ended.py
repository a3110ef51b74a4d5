"""When a fault ended: since when its sensor's readings are right again, and would have shown it.

Of a kind that reads something definite, undoing it to the end has to be decisively worse than leaving the readings as
they are since then. One that reads anything (noise, a tone, what belongs to no kind) has ended where its residual was
loud and is as quiet as ever since, in motion as lively.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gtmbench.detectors.bank.calibrated import MOST
from gtmbench.detectors.isolation.case import Case
from gtmbench.detectors.isolation.diagnosis import DECISIVE
from gtmbench.detectors.isolation.fits import FittedHypothesis, rows_between, suspect_through
from gtmbench.detectors.isolation.own_noise import is_straighter
from gtmbench.detectors.isolation.standing import meeting, passing
from gtmbench.detectors.virtual import ANGLES
from gtmbench.faults.fault import Fault, Following
from gtmbench.faults.kinds.replacing import Stuck
from gtmbench.faults.kinds.shaping import Saturation
from gtmbench.faults.registry import loaded_faults
from gtmbench.faults.shape import CONSTANT
from gtmbench.values.channels import GYROS
from gtmbench.values.record import FloatArray, IntArray, Span

_END = 20.0  # nats
_SHOWN, _LATER = 40.0, 12  # nats, with which a fault would have shown; ends that are tried until then
_STEP = 2  # rows between ends that are tried
_KAPPA = 4.0  # for the model's error, as of onsets
_DEFINITE = ("linear", "search", "gain", "sign", "fixed")  # what says enough of each reading
_CLEAR_S = 1.0  # of healthy residuals, until a fault has ended
_QUIET_S = 5.0  # of them, until one has that reads anything
_LOUD = 2.0  # times the power that was learnt, while it lasted
_AS_LIVELY = 0.7  # of the rates while it lasted


class End(NamedTuple):
    """When a fault had gone, and between which times that is with a probability of 95 %; None where nobody knows."""

    time_s: float
    between_s: Span | None

    @classmethod
    def of(cls, case: Case, ends: IntArray, deviances: FloatArray) -> End:
        """Return the end by -2 log likelihood of some of the rows judged, in order, that it was before each."""
        rows = np.arange(ends[0], ends[-1] + 1)
        low, row, high = (int(rows[at]) for at in rows_between(np.interp(rows, ends, deviances), _KAPPA))
        times_s = case.record.time_s[case.judged.start :]
        low_s, time_s, high_s = (float(times_s[at]) for at in (low, row, high))
        return cls(round(time_s, 9), (round(low_s - _STEP * case.period_s, 9), round(high_s, 9)))


def end_of(case: Case, best: FittedHypothesis, rival: float) -> End | None:
    """Return when a fault had gone, if it has: what came since is healthy, and the fault would have shown.

    Since then the residuals as they are must look healthy, and its own readings be held or rounded no longer. That must
    explain the record decisively better than the fault undone to the end, and than the best fault that lasts, whose BIC
    is `rival`: a saturation that isn't reached ends nothing. For gyros only: where an angle should be, the gyros can't
    say for long.
    """
    fault = fault_of(best)
    if fault is None or best.channel in ANGLES:
        return None
    suspect = suspect_through(case, best.channel, best.estimator)
    if suspect is None:
        return None
    begun = suspect.time_s >= fault.onset_s
    elapsed_s = suspect.time_s - fault.onset_s
    # what the fault would have added to the end, and what that makes of the residuals
    virtual = suspect.expected
    before = np.array([virtual[0]])
    reads, _ = fault.distort(virtual[:, np.newaxis], elapsed_s, case.period_s, fault.begin(before))
    added = np.where(begun, reads - virtual, 0.0)
    shown = suspect.shown(added[np.newaxis])[0]
    rows = case.judged.stop - case.judged.start
    gain, over = np.zeros(rows), np.zeros(rows)  # of leaving the record as it is; what it has over what is tolerated
    for i, output in enumerate(suspect.outputs):
        if output in case.residuals.raw:
            as_is = np.square(np.clip(suspect.white[i], -MOST, MOST))
            undone = np.square(np.clip(suspect.white[i] - shown[i], -MOST, MOST))
            gain += 0.5 * np.nan_to_num(undone - as_is)
            over += np.nan_to_num(as_is - case.monitor.tolerances[output].high)
    # gain(k) = (undone^2 - as it is^2) / 2: the sum from k on is by how much the record is likelier without the fault
    ended = int(np.argmax(np.cumsum(gain[::-1])[::-1]))  # since then, leaving it gains most
    clear = ended + 1 + max(case.monitor.whiteners[output].order for output in case.residuals.raw)
    since = rows - clear  # whitening remembers the fault
    if since * case.period_s < _CLEAR_S:
        return None
    # whitening smears the end over the rows before, and it shows only where the fault would have, had it lasted
    late = ended + int(np.argmax(np.cumsum(gain[ended:]) > _SHOWN))
    before = np.arange(max(2 * ended + 1 - clear, 0), ended + 1, _STEP)
    ends = np.unique(np.concatenate([before, np.linspace(ended, late, _LATER).astype(int)]))
    # of these ends the likeliest, the fault undone until then
    trials = np.where(np.arange(len(added)) < (suspect.judged.start + ends)[:, np.newaxis], added, 0.0)
    deviances = suspect.deviances(suspect.white - suspect.shown(trials))
    ended = int(ends[np.argmin(deviances)])
    lasting = float(deviances.min()) + suspect.elsewhere + (len(best.parameters) + 1) * float(np.log(max(rows, 2)))
    # a sum of n squares of unit noise deviates by sqrt(2 n)
    healthy = over[clear:].sum() <= 6.0 * np.sqrt(2.0 * since * len(shown))
    healthy = healthy and not is_straighter(suspect.measured[suspect.judged][clear:], case.habits.get(best.channel))
    if not healthy or gain[ended:].sum() < _END or lasting > rival - DECISIVE:
        return None
    return _at_limit(case, best) or End.of(case, ends, deviances)


def _at_limit(case: Case, best: FittedHypothesis) -> End | None:
    """Return the end of a saturation by the readings: after the last at its limit, before the first beyond; or None."""
    if best.kind != Saturation.kind:
        return None
    sizes, limit = np.abs(case.record[best.channel][case.start :]), best.parameters["limit"]
    held = meeting(sizes, limit)
    last = int(held[-1]) if len(held) else 0
    beyond = last + passing(sizes[last:], limit)
    if not last or not len(beyond):
        return None
    low_s, high_s = (round(float(case.record.time_s[case.start + at]), 9) for at in (last, int(beyond[0])))
    return End(round(0.5 * (low_s + high_s), 9), (low_s, high_s))


def quiet_since(case: Case, channel: str) -> End | None:
    """Return since when a gyro's residual is as quiet as ever that was loud before, while its fault lasted; or None.

    With the power P of n whitened samples e(k) until then, and 1 since, the samples since are likelier by the sum of
    (log P + e(k)^2 / P - e(k)^2) / 2 nats.
    """
    if channel not in GYROS or channel not in case.residuals.raw or channel in case.driving:
        return None
    white = case.white[channel][case.judged]
    squares = np.square(np.clip(np.nan_to_num(white), -MOST, MOST))
    rows, least = len(squares), round(_QUIET_S / case.period_s)
    ends = np.arange(least, rows - least)
    if not len(ends):
        return None
    # power P before each possible end, 1 since: -(n log P + n + sum since) / 2, but for what is the same for all
    until = np.cumsum(squares)
    power = np.maximum(until[ends - 1] / ends, 1e-12)
    since, count = until[-1] - until[ends - 1], rows - ends
    likelier = -0.5 * (ends * np.log(power) + ends + since)
    best = int(np.argmax(likelier))
    end, gain = int(ends[best]), 0.5 * (count * np.log(power) + since / power - since)[best]
    tolerance = case.monitor.tolerances[channel].high
    is_quiet = since[best] - count[best] * tolerance <= 6.0 * np.sqrt(2.0 * count[best])
    if power[best] < _LOUD or gain < _END or not is_quiet or not _is_as_lively(case, channel, end):
        return None
    if is_straighter(case.record[channel][case.judged][end:], case.habits.get(channel)):
        return None
    return End.of(case, ends, -2.0 * likelier)


def _is_as_lively(case: Case, channel: str, end: int) -> bool:
    """Tell whether the aircraft turned about a gyro's axis after a row of those judged as it did before."""
    turning = np.abs(np.nan_to_num(case.virtual[channel][case.judged]))
    return bool(turning[end:].mean() >= _AS_LIVELY * turning[:end].mean())


def fault_of(fit: FittedHypothesis) -> Fault | None:
    """Return the fault that a fit tells of, where that reads something definite."""
    parameters = dict(fit.parameters)
    onset_s = parameters.pop("onset_s", -1e9)
    if fit.how in CONSTANT:
        return Stuck(channel=fit.channel, onset_s=onset_s, value=parameters["value"])
    cls = loaded_faults().get(fit.kind)
    if cls is None or fit.how not in _DEFINITE or fit.partner is not None or issubclass(cls, Following):
        return None  # the errors of what follows its own readings add up
    figures: dict[str, Any] = parameters
    return cls(channel=fit.channel, onset_s=onset_s, **figures)
