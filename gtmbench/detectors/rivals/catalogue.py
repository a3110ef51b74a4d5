"""The rivals by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gtmbench.checks import meant, shown
from gtmbench.detectors.rivals.autoencoder import Autoencoder
from gtmbench.detectors.rivals.cusum import RawCusum
from gtmbench.detectors.rivals.isolation_forest import IsolationForest
from gtmbench.detectors.rivals.kalman import LinearKalmanFilter
from gtmbench.detectors.rivals.kinematic_kalman import KinematicKalmanFilter
from gtmbench.detectors.rivals.ksfd import KinematicConsistency
from gtmbench.detectors.rivals.limit_checks import LimitChecks
from gtmbench.detectors.rivals.one_step import OneStepPrediction
from gtmbench.detectors.rivals.pca import PrincipalComponents
from gtmbench.detectors.rivals.recursive import RecursiveLeastSquares
from gtmbench.detectors.rivals.rival import Rival, RivalMonitor
from gtmbench.errors import InputError

# under the settings of their sources, where `name` and what stands beside it say nothing else
RIVALS: dict[str, Rival] = {
    rival.name: rival
    for rival in (
        LimitChecks(),
        RawCusum(),
        PrincipalComponents(),
        PrincipalComponents(name="dynamic-pca", lags=3),
        OneStepPrediction(),
        OneStepPrediction(name="okid-no-commands", commands=False),
        OneStepPrediction(name="prediction", own_past=False),
        OneStepPrediction(name="prediction-no-commands", own_past=False, commands=False),
        LinearKalmanFilter(),
        LinearKalmanFilter(name="kalman-20-percent-off", parameter_error=0.2),
        KinematicKalmanFilter(),
        KinematicKalmanFilter(name="kinematic-kalman-no-fir", past_s=0.0),
        KinematicConsistency(),
        KinematicConsistency(name="ksfd-whitened", judge="glr", forces=False),
        RecursiveLeastSquares(),
        IsolationForest(),
        Autoencoder(),
    )
}


def restore_rival(figures: Mapping[str, Any], provenance: Mapping[str, Any]) -> RivalMonitor:
    """Return the monitor of a rival, whichever its figures are of; every key is checked.

    Raises
    ------
    InputError
        Naming the key, what stands there and what should.
    """
    name = figures.get("name")
    if not isinstance(name, str) or name not in RIVALS:
        raise InputError(f"figures.name is {shown(name)}; there are {', '.join(RIVALS)}{meant(name, RIVALS)}")
    return RIVALS[name].restore(figures, provenance)
