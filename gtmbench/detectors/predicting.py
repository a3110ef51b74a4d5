"""Monitors that predict sensors: what checks, certificates and doubts ask of one, whichever it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol, TypeGuard

from gtmbench.detectors.assumptions import Basis, basis_of
from gtmbench.detectors.excursion import Excursion
from gtmbench.detectors.monitor.superposition import Superposition
from gtmbench.detectors.protocol import Monitor, Watch
from gtmbench.jobs.progress import Progress, silent
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.values.record import FloatArray, Record


class PredictingMonitor(Monitor, Protocol):
    """A `Monitor` with residuals of its own for the sensors that its basis says it predicts.

    Attributes
    ----------
    basis : Basis
        With `predicts`.
    operators : mapping of sensor to Transmissibility
    """

    @property
    def basis(self) -> Basis: ...  # noqa: D102
    @property
    def operators(self) -> Mapping[str, Transmissibility]: ...  # noqa: D102

    def watch(
        self,
        record: Record,
        *,
        outside: Sequence[Excursion] = (),
        before: Record | None = None,
        progress: Progress = silent,
    ) -> Watch:
        """Return everything that it says of a record, of which some stretches say nothing, after a healthy one."""

    def residual(self, record: Record, sensor: str) -> FloatArray:
        """Return e(k) of a sensor, shape (samples,), NaN where it isn't known."""

    def superposition(self, watch: Watch, sensor: str) -> Superposition:
        """Return what faults of a sensor would do to its score on a record that was watched."""


def predicts(monitor: object) -> TypeGuard[PredictingMonitor]:
    """Tell whether a monitor predicts sensors.

    >>> import gtmbench as gb
    >>> predicts(gb.FunctionDetector(len).calibrate())
    False
    """
    return bool(basis_of(monitor).predicts) and hasattr(monitor, "superposition")
