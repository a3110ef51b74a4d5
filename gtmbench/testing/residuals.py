"""The assertion on residuals."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np

from gtmbench.channels import unit_of
from gtmbench.checks import number, shown
from gtmbench.errors import InputError
from gtmbench.kept import kept
from gtmbench.method.residual import Residual, residual
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.record import Record, check_record

Predictor = Transmissibility | Callable[[Record], Residual]
Bound = float | Mapping[str, float]


def assert_residual(record: Record, operator: Predictor, *, below: Bound, rms_below: Bound | None = None) -> None:
    """Fail where the residual of an operator reaches a bound anywhere on a record.

    Parameters
    ----------
    record : Record
        Of a part only: ``record.between(25, 200)``.
    operator : Transmissibility or callable
        Or a function from a record to a `Residual`, such as ``lambda record: gb.innovations(operator, record)``.
    below : float or mapping of output to float
        What every ``|e(k)|`` has to stay below, in the output's unit: one spike fails it. Residuals that need a
        missing sample don't exist and are passed over; some must exist.
    rms_below : float or mapping of output to float, optional
        What the root mean square over the record has to stay below.

    Raises
    ------
    AssertionError
        Naming output, figure, bound and recording.
    InputError
        Where an argument can't be meant.

    Examples
    --------
    >>> from gtmbench import identify
    >>> u = np.random.default_rng(1).standard_normal(500)
    >>> record = Record(np.column_stack([u, 2.0 * u]), channels=["u", "y"], sample_period_s=0.01)
    >>> operator = identify(record, inputs=["u"], outputs=["y"], causal_order=1, noncausal_order=1)
    >>> assert_residual(record, operator, below=0.01)
    """
    __tracebackhide__ = True
    check_record(record)
    found = _residual(record, operator)
    bounds = _bounds("below", below, found.outputs)
    failed = [complaint for name in found.outputs for complaint in _too_large(found, name, bounds[name])]
    if rms_below is not None:
        rms_bounds = _bounds("rms_below", rms_below, found.outputs)
        failed += [complaint for name in found.outputs for complaint in _too_strong(found, name, rms_bounds[name])]
    if not failed:
        return
    said = "; ".join(failed)

    def write(path: Path) -> None:
        from gtmbench.report.recording.failure import write_residual_recording

        inputs = operator.inputs if isinstance(operator, Transmissibility) else ()
        write_residual_recording(found, path, record=record, inputs=inputs, bounds=bounds, said=said)

    raise AssertionError(f"{said}; {kept().record(write)}")


def _residual(record: Record, operator: Predictor) -> Residual:
    if isinstance(operator, Transmissibility):
        return residual(operator, record)
    if not callable(operator):
        raise InputError(f"a {type(operator).__name__} is no operator; give a Transmissibility, or a function")
    found = operator(record)
    if not isinstance(found, Residual):
        raise InputError(f"the function returned a {type(found).__name__}; it has to return a Residual")
    return found


def _bounds(name: str, given: Bound, outputs: tuple[str, ...]) -> dict[str, float]:
    table = given if isinstance(given, Mapping) else dict.fromkeys(outputs, given)
    if set(table) != set(outputs):
        raise InputError(
            f"{name} is for {', '.join(map(shown, table))}; give a number, or one for each of {', '.join(outputs)}"
        )
    return {output: number(f"{name} of {output}", table[output], 0.0, above=True) for output in outputs}


def _too_large(found: Residual, output: str, bound: float) -> Iterator[str]:
    sizes = np.abs(found.values[:, found.outputs.index(output)])
    if np.isnan(sizes).all():
        yield f"residual of {output} exists at no sample: samples are missing, or the record is too short"
        return
    peak = int(np.nanargmax(sizes))
    if sizes[peak] >= bound:
        reached = f"reached {_figure(sizes[peak], output)} at {found.time_s[peak]:.2f} s"
        yield f"residual of {output} {reached} (allowed: below {_figure(bound, output)})"


@np.errstate(over="ignore")  # the square of 1e200 is inf: above every bound
def _too_strong(found: Residual, output: str, bound: float) -> Iterator[str]:
    values = found.values[:, found.outputs.index(output)]
    there = values[~np.isnan(values)]
    rms = float(np.sqrt(np.mean(np.square(there)))) if len(there) else 0.0  # none: that has been told
    if rms >= bound:
        yield f"residual of {output} has an RMS of {_figure(rms, output)} (allowed: below {_figure(bound, output)})"


def _figure(value: float, output: str) -> str:
    return f"{value:.4g} {unit_of(output)}".rstrip()
