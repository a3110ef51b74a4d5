"""A review of an open fault: what its case says at a horizon, and what comes of that.

Nothing happens here: `alarms.AlarmLogic` lets happen what a review gives.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

from gtmbench.detectors.alarm import NOISE_CHANGED, Alarm, Judgement
from gtmbench.detectors.bank.calibrated import greatest
from gtmbench.detectors.excursion import Excursion
from gtmbench.detectors.isolation.case import Case
from gtmbench.detectors.isolation.diagnosis import DECISIVE, by_signature, is_bent_far, looks_like_motion, only_doubts
from gtmbench.detectors.isolation.ended import End, end_of, fault_of, quiet_since
from gtmbench.detectors.isolation.fits import FittedHypothesis, hopeless, ranked_hypotheses
from gtmbench.detectors.isolation.onset import dated
from gtmbench.detectors.isolation.probability import kind_margin, with_probability
from gtmbench.detectors.isolation.several import SEVERAL, judge_all
from gtmbench.detectors.monitor.open_faults import HORIZONS_S, OpenFault, earlier, rows_of, trusted
from gtmbench.faults.registry import how_of
from gtmbench.faults.shape import SHOWN

_SURE_S = 5.0  # after an alarm: whether the noise has changed, or what is decisive has lasted
_LONG_S = 20.0  # after an alarm: what looks have said until then, twice, the next one says, too
_CHANGED = "earlier looks named another sensor"
_CALM_S = 4.0  # of healthy residuals, until an alarm that can't be told has passed


@dataclass(frozen=True, kw_only=True)
class FaultClosing:
    """How a fault is closed."""

    end: End | None = None  # when it had gone; None where there is nothing to tell of it
    known_s: float | None = None  # when that was known
    anew: bool = False  # whether the noise has changed, so that from now on it is learnt anew


def review(
    fault: OpenFault,
    case: Case,
    begin: Callable[[], Case],
    others: Iterable[OpenFault],
    row: int,
    without: Iterable[str] = (),
) -> tuple[OpenFault, FaultClosing | None]:
    """Return what a fault is by its case, which ends with a row of the record, and how it is closed, if it is.

    A late one tells of its end alone. So does one that is decided, unless it seems to have ended: then what is still
    there is weighed against that.

    `begin`: gives the case of the fault's onset. `others`: all that are open. `without`: families of hypotheses that
    aren't tried.
    """
    if not case.is_ripe:
        return fault, None
    if fault.is_late or fault.is_decided:
        end = _end(fault, case, ())
        if end is None or fault.is_late:
            return fault, end
    ranking = ranked_hypotheses(case, case.suspects, without)
    end = _end(fault, case, ranking)
    if end is not None:
        return fault, end
    first = by_signature(fault.monitor, trusted(fault, others), fault.crossing.output, fault.alarm.time_s)
    judged = _beside_others(fault, judge_all(case, ranking, first, without), others)
    judged = _consistent_with_earlier(judged, fault.alarm)
    if _is_worse(case, judged, fault.alarm.last):
        return fault, None
    judged = with_probability(case, ranking, _in_motion(fault, case, _settling(fault, case, judged), first))
    if judged.failed:
        judged = _in_motion(fault, case, dated(begin, judged, fault.alarm.last), first)
    if judged.doubt and _was_named_before(fault.turned, fault.alarm.last):
        return fault, None
    reviewed = replace(
        fault,
        alarm=replace(fault.alarm, judgements=(*fault.alarm.judgements, judged)),
        is_judged=True,
        ruled_out=fault.ruled_out | (hopeless(case, ranking, case.suspects) - set(judged.candidates)),
        held=_decisive(ranking, judged) or fault.held,
        is_decided=fault.is_decided or _is_decided(fault, ranking, judged, row),
    )
    return reviewed, _closing(case, judged, row - fault.row)


def _beside_others(fault: OpenFault, judged: Judgement, others: Iterable[OpenFault]) -> Judgement:
    """Return a judgement without its name, where an earlier alarm that nobody can tell may be what it tells of.

    What began with it and enters this residual isn't this sensor's.
    """
    if judged.sensor is None or how_of(judged.kind) in SHOWN:
        return judged
    for each in earlier(fault, others):
        alarm = each.alarm
        is_open = each.is_judged and alarm.sensor is None and alarm.accuses and not alarm.is_of_several
        is_beside = each.began_with(fault.crossing) and fault.crossing.output in each.enters
        if is_open and is_beside and judged.sensor not in alarm.candidates:
            names = tuple(dict.fromkeys([judged.sensor, *alarm.candidates]))
            return replace(judged, sensor=None, partner=None, candidates=names, reason=SEVERAL)
    return judged


def _consistent_with_earlier(judged: Judgement, alarm: Alarm) -> Judgement:
    """Return a judgement without its name, where an earlier look named another sensor: one of both was wrong.

    What explains a minute by a walk, or by two sensors at once, may be a model that errs as slowly.
    """
    before = [each.sensor for each in alarm.judgements if each.sensor is not None and not each.doubt]
    if not judged.failed or {*before} <= {*judged.failed}:
        return judged
    names = tuple(dict.fromkeys([*judged.candidates, *before]))
    return replace(judged, sensor=None, partner=None, together=(), candidates=names, reason=_CHANGED)


def _is_decided(fault: OpenFault, ranking: Sequence[FittedHypothesis], judged: Judgement, row: int) -> bool:
    """Tell whether an alarm is decided: two looks in a row name one sensor and one kind of fault, without a doubt.

    The kind decisively, or until the looks have become long. A sensor that reads one value may yet move.
    """
    last, since = fault.alarm.last, row - fault.row
    if (
        last is None
        or judged.doubt
        or judged.sensor is None
        or (last.sensor, last.kind) != (judged.sensor, judged.kind)
    ):
        return False
    margin = kind_margin(ranking, judged)
    least_s = _SURE_S if margin > DECISIVE else _LONG_S
    return since >= rows_of(least_s, fault.monitor) and margin < float("inf")


def _end(fault: OpenFault, case: Case, ranking: Sequence[FittedHypothesis]) -> FaultClosing | None:
    """Return how a fault is closed that has ended: by what was decisive of it, or once it is quiet; None if neither."""
    if fault.held is not None:
        lasting = min((fit.bic for fit in ranking if fit.lasts), default=float("inf"))
        end = end_of(case, fault.held, lasting)
    else:
        last = fault.alarm.last
        quiet = [quiet_since(case, name) for name in (() if last is None else last.failed)]
        end = max((each for each in quiet if each is not None), default=None) if None not in quiet else None
    return None if end is None else FaultClosing(end=end, known_s=case.end_s)


def _is_worse(case: Case, judged: Judgement, last: Judgement | None) -> bool:
    """Tell whether a judgement says less than the last one, and only because an attitude has bent since."""
    if last is None:
        return False
    is_named = judged.sensor is not None or last.sensor is None
    if is_named and set(judged.candidates) <= set(last.candidates):
        return False
    return only_doubts(case, judged, last) or is_bent_far(case)


def _settling(fault: OpenFault, case: Case, judged: Judgement) -> Judgement:
    """Doubt a judgement while an excursion may still be what it tells of."""
    excursion = fault.settling
    if excursion is None or not judged.candidates or case.end_s >= excursion.end_s + excursion.settles_s:
        return judged
    return replace(judged, sensor=None, partner=None, doubt=excursion.reason)


def _in_motion(fault: OpenFault, case: Case, judged: Judgement, first: Judgement) -> Judgement:
    """Doubt a judgement that motion beyond what the monitor knows would explain, too.

    What began in it isn't told until it has settled; and where it came after the onset, as of a fault that makes an
    aircraft depart, a model's error in it looks like a sensor that reads anything.
    """
    if fault.turned is None or not judged.candidates or judged.doubt:
        return judged
    before = fault.turned_before(judged.parameters.get("onset_s", -math.inf))
    is_settling = before is not None and case.end_s < before.end_s + before.settles_s
    if not is_settling and not looks_like_motion(judged):
        return judged
    return replace(first, time_s=judged.time_s, sensor=None, doubt=fault.turned.reason)


def _was_named_before(turned: Excursion | None, last: Judgement | None) -> bool:
    """Tell whether a sensor was named, without a doubt, before motion came that leaves doubts."""
    return turned is not None and last is not None and last.sensor is not None and last.time_s < turned.start_s


def _decisive(ranking: Sequence[FittedHypothesis], judged: Judgement) -> FittedHypothesis | None:
    """Return the hypothesis of a kind that is told decisively, where it reads something definite."""
    if judged.sensor is None or kind_margin(ranking, judged) <= DECISIVE:
        return None
    named = next((fit for fit in ranking if (fit.channel, fit.kind) == (judged.sensor, judged.kind)), None)
    return None if named is None or fault_of(named) is None else named


def _closing(case: Case, judged: Judgement, since: int) -> FaultClosing | None:
    """Return how an alarm is closed, `since` rows ago, that leaves nothing to explain or can't be told any better."""
    if judged.doubt == NOISE_CHANGED:
        return FaultClosing(anew=True) if since >= rows_of(_SURE_S, case.monitor) else None
    if not judged.candidates:
        return FaultClosing()
    if judged.doubt and _has_calmed(case):
        return FaultClosing(end=End(case.end_s, None), known_s=case.end_s)
    is_given_up = judged.doubt and since >= rows_of(HORIZONS_S[-1], case.monitor)
    return FaultClosing() if is_given_up else None  # should it calm later, watching goes on


def _has_calmed(case: Case) -> bool:
    """Tell whether nothing is wrong any more: what raised a doubtful alarm has gone, so watching goes on."""
    rows = rows_of(_CALM_S, case.monitor)
    if case.judged.stop - case.judged.start < rows:
        return False
    late = slice(case.judged.stop - rows, case.judged.stop)
    return all(greatest(case.monitor, output, case.white[output][late]) <= 1.0 for output in case.residuals.raw)
