"""``gtmbench check``: run what a baseline names, and hold its figures against those recorded there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gtmbench.check.baseline import Reference
from gtmbench.check.compare import Compared, compare
from gtmbench.check.figures import FigureGroup, figures_of
from gtmbench.check.logs import log_groups
from gtmbench.checks import naming
from gtmbench.detectors.bank.composed import AUTO
from gtmbench.detectors.protocol import Detector, Monitor
from gtmbench.jobs.progress import Progress, silent
from gtmbench.study.run import run_study


@dataclass(frozen=True, kw_only=True)
class Check:
    """A baseline, held against a run."""

    reference: Reference
    groups: tuple[FigureGroup, ...]  # what the run gave
    compared: tuple[Compared, ...]  # every figure beside the recorded one

    @property
    def regressions(self) -> list[Compared]:
        """The figures that are worse than allowed, the furthest beyond its tolerance first."""
        return sorted((figure for figure in self.compared if figure.regressed), key=lambda figure: -figure.excess)

    @property
    def better(self) -> list[Compared]:
        """The figures that are better than recorded by more than the tolerance."""
        return [figure for figure in self.compared if figure.better]


def run_reference(
    reference: Reference, *, detector: Detector | Monitor | None = None, progress: Progress = silent
) -> tuple[FigureGroup, ...]:
    """Run what a baseline names and return its figures; `detector`: what goes by the name that the baseline states."""
    watcher = reference.detector if detector is None else detector
    groups: list[FigureGroup] = []
    if reference.scenarios:
        watches = [] if watcher is None else [watcher]
        groups += figures_of(run_study(reference.scenarios, detectors=watches, seed=reference.seed, progress=progress))
    if reference.logs:
        how = {"history": reference.history, "aircraft_id": reference.aircraft_id, "mapping": reference.mapping}
        groups += log_groups(reference.logs, watcher or AUTO, progress, **how)
    return tuple(groups)


def check(reference: Reference, groups: Sequence[FigureGroup]) -> Check:
    """Hold the figures of a run against a baseline.

    Raises InputError where the baseline lacks a figure, or holds one that the run doesn't give.
    """
    with naming(reference.path):
        compared = compare(reference.recorded, groups, reference.tolerances)
    return Check(reference=reference, groups=tuple(groups), compared=compared)
