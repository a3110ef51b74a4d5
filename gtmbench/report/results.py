"""Results as plain data: ``results.json`` and ``trials.csv``."""

from __future__ import annotations

import csv
import json
import platform
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from gtmbench.channels import unit_of
from gtmbench.method.monitoring.tails import rate_bound
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.study.trial import Study
from gtmbench.version import __version__

SCHEMA = 1
_LIBRARIES = ("jsbsim", "numpy", "scipy", "pandas", "rerun-sdk")


def results(study: Study) -> dict[str, Any]:
    """Return a study as one JSON-ready object, schema 1; units stand in the names."""
    baseline = study.baseline
    return {
        "schema": SCHEMA,
        "trim": asdict(baseline.trim),
        "operator": _operator(baseline.operator),
        "threshold": baseline.threshold,
        "threshold_unit": unit_of(baseline.operator.outputs[0]),
        "armed_s": baseline.armed_s,
        "trials": [trial.row() for trial in study.trials],
        "false_alarms": baseline.false_alarms,
        "healthy_hours": baseline.healthy_hours,
        "false_alarms_per_hour_at_most": rate_bound(baseline.false_alarms, baseline.healthy_hours),
        "setup": asdict(baseline.setup),
        "versions": {
            "gtmbench": __version__,
            "python": platform.python_version(),
            **{name: version(name) for name in _LIBRARIES},
        },
        "seed": baseline.setup.seed,
    }


def _operator(operator: Transmissibility) -> dict[str, Any]:
    return {
        "name": operator.name,
        "inputs": list(operator.inputs),
        "outputs": list(operator.outputs),
        "causal_order": operator.causal_order,
        "noncausal_order": operator.noncausal_order,
        "sample_period_s": operator.sample_period_s,
        "samples": operator.samples,
        "estimator": operator.estimator,
        "solver": operator.solver,
        "rank": operator.rank,
        "condition": operator.condition,
        "rms_residual": operator.rms_residual.tolist(),
        "input_means": operator.input_means.tolist(),
        "output_means": operator.output_means.tolist(),
    }


def write_results(study: Study, folder: Path) -> None:
    """Write ``results.json`` and ``trials.csv`` (one row a trial; severities as ``name=value``)."""
    found = results(study)
    (folder / "results.json").write_text(json.dumps(found, indent=2, allow_nan=False) + "\n")
    rows = [
        {**row, "severity": " ".join(f"{name}={value!r}" for name, value in row["severity"].items())}
        for row in found["trials"]
    ]
    with (folder / "trials.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
