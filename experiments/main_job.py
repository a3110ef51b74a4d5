"""The main job by numbers: bank C and the dissertation's operator on its fifteen faults, as README tells it.

Run ``python experiments/main_job.py [--out DIR]``: what `gtmbench run --detector C --detector dissertation` does, a row
a trial, with the code's digest. README, release notes and paper take their figures from it (`make figures`). One
flight: what it says of detection bounds no other flight's.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import click

import gtmbench as gb
from gtmbench.files.plain import dumps
from gtmbench.files.shipped import code_facts
from gtmbench.files.writing import atomic_write

SCENARIOS = ("deadzone", "drift", "jam", "rate_saturation", "saturation")
DETECTORS = ("C", "dissertation")
SEEDS = range(1, 11)  # of the dissertation's operator alone, with its own noise, SNR 50


def rows(study: gb.Study) -> dict[str, object]:
    """Return a row a trial, and what healthy records gave."""
    told = ("detector", "scenario", "channel", "detected", "detection_delay_s", "isolated", "named_wrong")
    return {
        "trials": [
            {**{name: getattr(trial, name) for name in told}, "isolation_delay_s": trial.isolation_delay_s}
            for trial in study.trials
        ],
        "healthy": [
            {"detector": each.detector, "false_alarms": each.false_alarms, "hours": each.healthy_hours}
            for each in study.baselines
        ],
    }


def main() -> int:
    """Run the study and write its rows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--out", type=Path, default=Path(__file__).parent / "reports/main_job", help="folder of the rows"
    )
    out = parser.parse_args().out
    scenarios = [gb.load_scenario(name) for name in SCENARIOS]
    study = gb.run_study(scenarios, detectors=DETECTORS)
    own = {seed: gb.run_study(scenarios, seed=seed) for seed in SEEDS}
    results = {
        "script": "main_job.py",
        "command": "python experiments/main_job.py",
        "code": code_facts(("numpy", "scipy", "jsbsim")),
        **rows(study),
        "own noise": [{"seed": seed, **rows(each)} for seed, each in own.items()],
    }
    out.mkdir(parents=True, exist_ok=True)
    with atomic_write(out / "results.json") as path:
        path.write_text(dumps(results, indent=1) + "\n", encoding="utf-8")
    for name in DETECTORS:
        found = [trial.detected for trial in study.trials_of(name)]
        click.echo(f"{name}: {sum(found)} of {len(found)} detected")
    return 0


if __name__ == "__main__":
    sys.exit(main())
