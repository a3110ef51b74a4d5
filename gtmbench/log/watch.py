"""A recorded flight, watched: by a monitor that is ready, or one that is learnt on a part of it or on other logs.

A log goes through stages, each in a file of its own: a question is asked (`asked`), the files are read and opened
(`opened`), what is healthy is chosen (`chosen`), the monitor is learnt where the wiring is as it should be (`learnt`),
it listens to the rest (`listened`), the engine judges the whole, and what it doesn't hold is doubted (`doubted`); where
there is no attitude, one of the log's end looks at what was learnt from (`swapped`); and it is concluded (`concluded`).
Each stage takes the value of the one before; what has stopped is passed on.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gtmbench.detectors.bank.bank import Bank, bank_of
from gtmbench.detectors.protocol import Detector, Monitor, is_ready
from gtmbench.errors import InputError
from gtmbench.jobs.progress import Progress, silent
from gtmbench.jobs.threads import on_one_thread
from gtmbench.log.judging.learnt_part import swapped
from gtmbench.log.judging.monitored import doubted, listened
from gtmbench.log.learning.healthy_part import chosen
from gtmbench.log.learning.learnt_monitor import Learnt, learnt
from gtmbench.log.opening.driven_attitude import FROM_LOG
from gtmbench.log.opening.opened_log import opened
from gtmbench.log.opening.question import asked
from gtmbench.log.watched_log import WatchedLog, concluded
from gtmbench.method.problem import operator_names
from gtmbench.method.pseudo_inputs import raw_needs
from gtmbench.values.record import Span
from gtmbench.verdict.scope import JUDGED


def bank_between(inputs: Sequence[str], outputs: Sequence[str], *, look_s: float = 0.5) -> Bank:
    """Return a bank of operators from some channels to others, each judged by the energy of its residual.

    Parameters
    ----------
    inputs, outputs : sequence of str
        Pseudo inputs (channels, or names of `PSEUDO_INPUTS`) and pseudo outputs.
    look_s : float
        r Ts and d Ts, in seconds: how far they look back and ahead.

    Examples
    --------
    >>> import gtmbench as gb
    >>> bank = gb.bank_between(["p", "q", "beta"], ["r"])
    >>> bank.name, bank.suspects
    ('[p q beta] -> r', ('r', 'p', 'q', 'beta'))
    """
    u, y = operator_names(inputs, outputs)
    look = {"look_back_s": look_s, "look_ahead_s": look_s}
    suspects = dict.fromkeys(raw for name in (*y, *u) for raw in sorted(raw_needs(name)))
    table = {
        "title": "identified on the log",
        "suspects": list(suspects),
        "residuals": [{"output": output, "inputs": list(u), **look} for output in y],
        "alarm": {"statistic": "energy", "windows_s": [0.5, 2.0], "two_sided": False},
    }
    return bank_of(f"[{' '.join(u)}] -> {' '.join(y)}", table)


@on_one_thread
def watch_log(
    path: str | Path,
    detector: Detector | Monitor | Bank | str | Path,
    *,
    healthy: Sequence[Span | str | Path] = (),
    mapping: Sequence[str] = (),
    rate_hz: float | None = None,
    false_alarms_per_hour: float | None = None,
    attitude: str = FROM_LOG,
    judge: str | Sequence[str] | None = None,
    limits: Sequence[str] = (),
    judged: float = JUDGED,
    history: str | Path | None = None,
    aircraft_id: str = "",
    progress: Progress = silent,
) -> WatchedLog:
    """Open a recorded flight and watch it.

    A monitor (or a plain function) watches all of it. A detector is first calibrated on the `healthy` part and watches
    the rest; a bank allows for the uncertainty of a short record. A log that isn't what the monitor expects isn't
    watched, and `check` says why.

    Parameters
    ----------
    path : str or Path
        As `open_log` takes it.
    detector : Detector, Monitor, Bank, or a name
        As `find_detector` takes it; ``auto`` is the bank that the channels of the log, and of the healthy ones, allow.
    healthy : sequence of (start, end), str or Path
        For a detector: spans of this log in seconds (ends may be infinite), or other logs, read alike. Without any, the
        first 40 % of this log, 300 s at most.
    mapping : sequence of str
        As `open_log` takes it.
    rate_hz : float, optional
        For a detector: the rate to resample to, in Hz; by default the slowest channel's, 100 at most. A monitor has its
        own.
    false_alarms_per_hour : float, optional
        The rate to calibrate for. By default 0.002 for a bank, and 1 for one that is judged by its residuals' energy,
        as `bank_between`'s: most of that energy is the model's error, whose tail half a minute doesn't bound further.
    attitude : str
        For a bank that predicts gyros from the attitude: ``driven`` if the gyros drive it through an estimator, ``own``
        if it is independent. ``auto`` uses the format's documentation, otherwise the samples: driven unless they show
        that it is independent. A monitor keeps the setting of its calibration, and is believed less where the log's
        attitude is another.
    judge : str or sequence of str, optional
        The sensors that the verdict speaks for: ``p,q,r``, ``gyros``, ``attitude``, ``all``; by default p, q, r and the
        angles that the log has, of a monitor that compares these, and otherwise the sensors that it predicts.
    limits : sequence of str
        The sizes that may not hide in a span that is called clear: ``5deg/s`` and ``10deg`` by default; a factor, such
        as ``factor=0.7``, only where it is named.
    judged : float
        The least share of the time in motion for which each of these sensors has to be judged.
    history : str or Path, optional
        The flights of its airframe before, as ``gtmbench monitor --history`` wrote them: an error that is there from
        the first sample on is told beside them. Nothing is entered.
    aircraft_id : str
        Whose flight it is; by default by the hardware's identifier in the log, else by its folder.
    progress : callable
        Called with the step, the number done and the total.

    Raises
    ------
    InputError
        If a log can't be read, lacks channels, or holds too little that is healthy.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> noise = np.random.default_rng(1).standard_normal((3000, 2))
    >>> record = gb.Record(noise @ [[1.0, 1.0], [0.0, 0.1]], channels=["p", "q"], sample_period_s=0.04)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     gb.write_log(record, Path(folder, "flight.csv"))
    ...     watched = gb.watch_log(Path(folder, "flight.csv"), gb.bank_between(["p"], ["q"]), healthy=[(0.0, 60.0)])
    >>> watched.outcome, watched.identified_s
    (<Outcome.HEALTHY: 0>, ((0.0, 60.0),))
    """
    question = asked(
        path,
        detector,
        healthy=healthy,
        mapping=mapping,
        rate_hz=rate_hz,
        false_alarms_per_hour=false_alarms_per_hour,
        attitude=attitude,
        judge=judge,
        limits=limits,
        judged=judged,
    )
    monitor = learnt(chosen(opened(question, progress)), progress)
    watched = concluded(doubted(listened(monitor, progress), progress), swapped(monitor))
    if history is None:
        return watched
    from gtmbench.log.history import beside_history

    return beside_history(watched, Path(history), aircraft_id)


def taught_by(
    path: Path,
    detector: Detector,
    *,
    healthy: Sequence[Span],
    mapping: Sequence[str] = (),
    rate_hz: float | None = None,
    false_alarms_per_hour: float | None = None,
    attitude: str = FROM_LOG,
    progress: Progress = silent,
) -> Learnt:
    """Return the monitor that a log's healthy part teaches, as `watch_log` takes these; it watches nothing.

    Raises InputError as `watch_log`; and where the log isn't what the detector expects, or nothing of it is left to
    learn from.
    """
    question = asked(
        path,
        detector,
        healthy=healthy,
        mapping=mapping,
        rate_hz=rate_hz,
        false_alarms_per_hour=false_alarms_per_hour,
        attitude=attitude,
    )
    found = learnt(chosen(opened(question)), progress)
    if found.check.stops:
        causes = [f"{each.text}; type {each.to_type}" if each.to_type else each.text for each in found.check.causes]
        reasons = " or ".join(causes) or "; ".join(stop.text for stop in found.check.stops)
        raise InputError(f"{path}: nothing is learnt from it: {reasons}")
    if not is_ready(found.monitor):
        raise InputError(f"{path}: nothing is left to learn from but what failed; gtmbench monitor says what")
    return found
