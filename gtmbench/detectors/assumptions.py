"""What a detector or a monitor rests on beside its channels, for those who open logs for it and check what it says."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Basis:
    """What a detector rests on; one that has no attribute ``basis`` rests on its channels alone.

    Attributes
    ----------
    title : str
        What it is called where it is spoken of: ``bank C``.
    witnesses : tuple of str
        Channels that its diagnoses read where a record has them; no alarm stands on them.
    predicts : tuple of str
        Sensors with a residual of their own, by an operator from others (`predicting.PredictingMonitor`).
    kinematic : tuple of str
        Sensors that it compares with what kinematics say that they read.
    attitude_from_gyros : bool or None
        Whether it takes the gyros to drive the attitude; None where it compares no gyro with an attitude.
    is_cautious : bool
        Whether it stands on little flight: what alarms may be chance, or its model's error.
    looks_back_s : float
        How far before a sample its statistics look back.
    is_whole : bool
        Whether it learns nothing, and a log is judged as a whole: by the engine, which doesn't tell gyros and attitude.

    Examples
    --------
    >>> from gtmbench.detectors.registry import find_detector
    >>> basis_of(find_detector("C")).kinematic, basis_of(find_detector("dissertation"))
    (('p', 'q', 'r'), Basis(title='dissertation', ...))
    """

    title: str
    witnesses: tuple[str, ...] = ()
    predicts: tuple[str, ...] = ()
    kinematic: tuple[str, ...] = ()
    attitude_from_gyros: bool | None = None
    is_cautious: bool = False
    looks_back_s: float = 0.0
    is_whole: bool = False


def basis_of(watcher: object) -> Basis:
    """Return what a detector or a monitor rests on."""
    known = getattr(watcher, "basis", None)
    return known if isinstance(known, Basis) else Basis(title=str(getattr(watcher, "name", watcher)))
