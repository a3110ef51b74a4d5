"""Results as plain data: ``results.json`` and ``trials.csv``."""

from __future__ import annotations

import csv
import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from gtmbench.channels import unit_of
from gtmbench.detectors.bank.tails import rate_bound
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
        "versions": versions(),
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


def versions() -> dict[str, str]:
    """Return the versions of the package, of Python and of the libraries that the figures depend on."""
    return {
        "gtmbench": __version__,
        "python": platform.python_version(),
        **{name: version(name) for name in _LIBRARIES},
    }


def write_results(study: Study, folder: Path) -> None:
    """Write ``results.json`` and ``trials.csv`` (one row a trial; severities as ``name=value``)."""
    found = results(study)
    rows = [{**row, "severity": named(row["severity"])} for row in found["trials"]]
    write_tables(found, rows, folder)


def named(figures: Mapping[str, float | None]) -> str:
    """Write figures as ``name=value``, those that are None left out.

    >>> named({"slope": 0.05})
    'slope=0.05'
    """
    return " ".join(f"{name}={value!r}" for name, value in figures.items() if value is not None)


def write_tables(found: Mapping[str, Any], rows: Sequence[Mapping[str, Any]], folder: Path) -> None:
    """Write ``results.json`` from an object and ``trials.csv`` from rows of equal keys."""
    (folder / "results.json").write_text(json.dumps(found, indent=2, allow_nan=False) + "\n")
    with (folder / "trials.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
