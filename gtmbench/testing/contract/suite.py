"""The contract suite, for anyone's detector; and its properties of `calibrate`, of the monitor and of its file."""

from __future__ import annotations

import copy
import json
import pickle
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from gtmbench.detectors.monitor_file import load_monitor, save_monitor
from gtmbench.detectors.protocol import Monitor
from gtmbench.errors import InputError
from gtmbench.faults.fault import Fault
from gtmbench.testing.contract.subject import ContractCase, contract_case, refused, same
from gtmbench.testing.contract.watching import STREAM, WATCH
from gtmbench.values.record import Record

_RATE = 0.01  # false alarms an hour


def recalibrated(case: ContractCase) -> None:
    """Check that calibrating again gives the same monitor, and changes neither recipe nor records."""
    if case.detector is None:
        return
    recipe, samples = _state(case.detector), [record.values.tobytes() for record in case.healthy]
    again = case.detector.calibrate(list(case.healthy))
    assert _state(case.detector) == recipe, "calibrate changed the recipe"
    assert [record.values.tobytes() for record in case.healthy] == samples, "calibrate changed its records"
    _alike(case, again, "calibrated again, it says")
    figures = _figures(case.monitor)
    assert figures is None or figures == _figures(again), "calibrated again on the same records, its figures differ"


def rate(case: ContractCase) -> None:
    """Check that a false-alarm rate is either honoured or refused."""
    if case.detector is None:
        return
    try:
        monitor = case.detector.calibrate(list(case.healthy), _RATE)
    except InputError:
        refused(f"a rate of {_RATE:g} an hour", lambda: case.detector.calibrate(list(case.healthy), _RATE))  # type: ignore[union-attr]
    else:
        monitor.watch(case.healthy[0])


def frozen_value(case: ContractCase) -> None:
    """Check that the monitor can't be changed, and goes to other processes."""
    try:
        case.monitor.name = case.monitor.name  # type: ignore[misc]
    except (AttributeError, TypeError):
        pass
    else:
        raise AssertionError("its name can be set; make it a frozen dataclass")
    try:
        there = pickle.loads(pickle.dumps(case.monitor))  # noqa: S301
    except Exception as error:
        raise AssertionError(
            f"it can't be pickled ({type(error).__name__}: {error}); define its class or function at the top level of "
            "a module"
        ) from error
    _alike(case, there, "pickled and back, it says")


def stated(case: ContractCase) -> None:
    """Check that what a monitor states can be meant."""
    monitor = case.monitor
    assert isinstance(monitor.name, str), f"its name is {monitor.name!r}"
    assert monitor.name.strip(), "its name is empty"
    assert 0.0 <= monitor.look_ahead_s < float("inf"), f"look_ahead_s is {monitor.look_ahead_s}"
    assert monitor.memory_s >= 0.0, f"memory_s is {monitor.memory_s}"
    period_s = monitor.sample_period_s
    assert period_s is None or period_s > 0.0, f"sample_period_s is {period_s}"
    assert set(monitor.suspects) <= set(monitor.channels), f"suspects {monitor.suspects} aren't all among its channels"
    json.dumps(dict(monitor.provenance), allow_nan=False)


def saved(case: ContractCase) -> None:
    """Check that, saved and loaded, it says the same and saves as the same bytes; one without figures says so."""
    if _figures(case.monitor) is None:
        refused("saving a monitor without figures", case.monitor.figures)
        return
    if case.detector is not None and not hasattr(case.detector, "restore"):
        return
    with TemporaryDirectory() as folder:
        first, again = Path(folder, "first.json"), Path(folder, "again.json")
        save_monitor(case.monitor, first)
        loaded = load_monitor(first, case.detector)
        save_monitor(loaded, again)
        assert first.read_bytes() == again.read_bytes(), "saved, loaded and saved again, its file differs"
    assert _figures(loaded) == _figures(case.monitor), "loaded, its figures differ"
    _alike(case, loaded, "saved and loaded, it says")


def _alike(case: ContractCase, monitor: Monitor, what: str) -> None:
    watch = monitor.watch(case.record)
    same(case.told(watch.alarms), case.told(case.watch.alarms), what, "it said")
    for name, score in case.watch.scores.items():
        assert watch.scores[name].values.tobytes() == score.values.tobytes(), f"{what} another score '{name}'"


def _figures(monitor: Monitor) -> dict[str, Any] | None:
    """Return a monitor's figures as a file has them; None where it has none."""
    try:
        figures = monitor.figures()
    except InputError:
        return None
    stored: dict[str, Any] = json.loads(json.dumps(figures))
    return stored


def _state(recipe: Any) -> Any:
    try:
        return pickle.dumps(recipe)
    except Exception:  # a function within a function: what it holds is looked at
        return repr(copy.copy(vars(recipe)))


CALIBRATION: dict[str, Callable[[ContractCase], None]] = {
    "calibrated again": recalibrated,
    "rate": rate,
    "frozen": frozen_value,
    "stated": stated,
    "saved and loaded": saved,
}


CONTRACT: dict[str, Callable[[ContractCase], None]] = {**WATCH, **STREAM, **CALIBRATION}
"""By name, each a function of a `contract_case`, for ``pytest.mark.parametrize``."""


def check_detector(
    detector: object, records: Sequence[Record] | None = None, *, fault: Fault | Sequence[Fault] | None = None
) -> None:
    """Fail if a detector breaks the contract.

    Parameters
    ----------
    detector : Detector, Monitor, Bank, callable or str
        Whatever `gtmbench.find_detector` finds, or could return.
    records : sequence of Record
        Two or more healthy records of one flight or several. The detector is calibrated on all but the last, which it
        watches. By default three records of the T2's sensors on a flight of two minutes, at 50 Hz, with the surface
        commands.
    fault : Fault or sequence of Fault
        Injected into the last record; the detector must alarm on it. By default two steep drifts, of 12 s each.

    Raises
    ------
    AssertionError
        Naming the detector, the property and the figures.

    Examples
    --------
    >>> import numpy as np
    >>> check_detector("dissertation")
    >>> def hindsight(record):  # an alarm at the greatest p, which nobody knows before the end
    ...     return record.time_s[[int(np.nanargmax(record["p"]))]]
    >>> check_detector(hindsight)  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ...
    AssertionError: 'hindsight', cut: of a record cut at ... s the alarms are ..., those of the whole ...
    """
    __tracebackhide__ = True
    case = contract_case(detector, records, fault=fault)
    for name in CONTRACT:
        check_property(case, name)


def check_property(case: ContractCase, name: str) -> None:
    """Fail where a detector breaks one property, by its name in `CONTRACT`; whatever it raises is a breach, too."""
    __tracebackhide__ = True
    try:
        CONTRACT[name](case)
    except AssertionError as error:
        raise AssertionError(f"'{case.monitor.name}', {name}: {error}") from None
    except Exception as error:
        raise AssertionError(f"'{case.monitor.name}', {name}: it raised {type(error).__name__}: {error}") from error
