"""The contract suite: what every detector has to hold, each property by its name; for anyone's detector."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from gtmbench.faults.fault import Fault
from gtmbench.testing.contract.calibrating import CALIBRATION
from gtmbench.testing.contract.streaming import STREAM
from gtmbench.testing.contract.subject import ContractCase, contract_case
from gtmbench.testing.contract.watching import WATCH
from gtmbench.values.record import Record

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
