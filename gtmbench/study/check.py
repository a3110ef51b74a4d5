"""``gtmbench check``: run what a baseline names, and hold its figures against those recorded there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gtmbench.errors import InputError
from gtmbench.study.baseline_file import Reference
from gtmbench.study.check_compare import Compared, compare
from gtmbench.study.check_figures import Group, figures_of
from gtmbench.study.flown import Progress
from gtmbench.study.run import run_study


@dataclass(frozen=True, kw_only=True)
class Check:
    """A baseline, held against a run.

    Attributes
    ----------
    reference : Reference
    groups : tuple of Group
        What the run gave.
    compared : tuple of Compared
        Every figure beside the recorded one.
    """

    reference: Reference
    groups: tuple[Group, ...]
    compared: tuple[Compared, ...]

    @property
    def regressions(self) -> list[Compared]:
        """The figures that are worse than allowed, the furthest beyond its tolerance first."""
        return sorted((one for one in self.compared if one.regressed), key=lambda one: -one.excess)

    @property
    def better(self) -> list[Compared]:
        """The figures that are better than recorded by more than the tolerance."""
        return [one for one in self.compared if one.better]


def run_reference(reference: Reference, *, progress: Progress = lambda _step, _done, _of: None) -> tuple[Group, ...]:
    """Run what a baseline names and return its figures.

    Raises
    ------
    GtmbenchError
        Where that can't be run.
    """
    if reference.monitor is None:
        return figures_of(run_study(reference.scenarios, seed=reference.seed, progress=progress))
    from gtmbench.study.monitored import find_monitor, run_monitored

    monitor = find_monitor(reference.monitor)
    return figures_of(run_monitored(reference.scenarios, monitor, seed=reference.seed, progress=progress))


def check(reference: Reference, groups: Sequence[Group]) -> Check:
    """Hold the figures of a run against a baseline.

    Raises
    ------
    InputError
        Where the baseline lacks a figure, or holds one that the run doesn't give.
    """
    try:
        compared = compare(reference.recorded, groups, reference.tolerances)
    except InputError as error:
        raise InputError(f"{reference.path}: {error}") from error
    return Check(reference=reference, groups=tuple(groups), compared=compared)
