"""Section 4.4 of the dissertation, step by step: application to aircraft sensor health monitoring.

Run ``python experiments/aircraft_gyros.py [--quick] [--out DIR]``. It prints its numbers beside the printed ones and
draws the counterparts of Figs. 4.1-4.4 into DIR (not with ``--quick``); it ends with code 1 where they disagree.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

import gtmbench as gb
from gtmbench.report.figures import write_figures

# what is printed, with the tolerance at which the model is held to it: name -> (value, tolerance)
PRINTED_TRIM = {
    "altitude_ft": (8000.00, 0.01),
    "eas_kt": (89.18, 0.05),
    "tas_kt": (100.58, 0.01),
    "alpha_deg": (3.00, 0.05),
    "beta_deg": (0.0, 0.01),
    "gamma_deg": (0.0, 0.01),
    "roll_deg": (0.066, 0.1),  # a balance of hundredths of a degree: aircraft/gtm/README.md
    "pitch_deg": (3.00, 0.05),
    "yaw_deg": (45.00, 0.01),
    "ground_track_deg": (45.00, 0.01),
    "elevator_deg": (2.70, 0.15),
    "throttle_percent": (22.84, 2.5),
}
ONSET_S, WINDOW, R, D = 300.0, 1000, 50, 50


def check(name: str, printed: str, ours: str, agrees: bool) -> bool:
    """Print one row: what the dissertation says, what came out."""
    print(f"{name:<42} {printed:>24} {ours:>22}   {'agrees' if agrees else 'DISAGREES'}")
    return agrees


def trim() -> list[bool]:
    """Trim: level flight at 8000 ft and 100.58 kt."""
    found = gb.trim("gtm")
    rows = []
    for name, (printed, tolerance) in PRINTED_TRIM.items():
        ours = getattr(found, name)
        rows.append(
            check(f"trim, {name}", f"{printed:g} +- {tolerance:g}", f"{ours:.3f}", abs(ours - printed) <= tolerance)
        )
    return rows


def identify(record: gb.Record) -> gb.Transmissibility:
    """(4.13): the operator [p q beta] -> r, by PEM with a noncausal FIR model, 2,500 <= k <= 20,000."""
    return gb.identify(
        record.between(25, 200), inputs=["p", "q", "beta"], outputs=["r"], causal_order=R, noncausal_order=D
    )


def markov_parameters(operator: gb.Transmissibility) -> bool:
    """Entries of the Markov parameters (Fig. 4.1): r + d + 1 lags of a 1 x 3 operator."""
    lags, outputs, inputs = operator.markov.shape
    agrees = (lags, outputs, inputs) == (R + D + 1, 1, 3)
    return check("Fig. 4.1, Markov parameters", "101 of 1 x 3", f"{lags} of {outputs} x {inputs}", agrees)


def prediction(operator: gb.Transmissibility, record: gb.Record) -> bool:
    """One-step prediction of r, 28,000 <= k <= 28,500 (Fig. 4.2): the lines of the figure lie on each other."""
    shown = slice(28_000, 28_501)
    error = record["r"][shown] - operator.predict(record)[shown, 0]
    share = float(np.sqrt(np.mean(error**2)) / np.std(record["r"]))
    return check("Fig. 4.2, error of the prediction over r", "small", f"{share:.3f} (RMS)", share < 0.1)


def fault(operator: gb.Transmissibility, healthy: gb.Record, limit: float, broken: gb.Fault, figure: str) -> bool:
    """Figs. 4.3, 4.4: the residual's norm E(k), (4.12), increases after t = 300 s."""
    norms = [
        gb.windowed_norm(gb.residual(operator, record), window=WINDOW)
        for record in (healthy, gb.inject(healthy, broken))
    ]
    before = norms[0].time_s + (WINDOW + D) * healthy.sample_period_s < ONSET_S
    unchanged = np.array_equal(norms[0].values[before], norms[1].values[before], equal_nan=True)
    ratio = float(np.nanmax(norms[1].values[~before]) / limit)
    name = f"Fig. {figure}, {broken.kind} of {broken.channel}"
    return check(name, "E rises after 300 s", f"to {ratio:.1f} thresholds", unchanged and ratio > 1.0)


def excitation_dependence() -> bool:
    """Not in the dissertation: an operator identified on one sinusoid, asked about a multisine flight (T2 noise)."""
    flown = ("dissertation", "multisine")
    records = [gb.measure(gb.fly(excitation=name, seed=1), noise="t2", seed=1) for name in flown]
    operator = identify(records[0])
    own, other = (
        float(np.sqrt(np.mean(gb.residual(operator, record).values[20_000:48_001] ** 2))) for record in records
    )
    name = "residual on its own and another flight"
    return check(name, "(not shown)", f"{own:.2f} and {other:.1f} deg/s", other > 10.0 * own)


def main() -> int:
    """Run every step of section 4.4."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--quick", action="store_true", help="leave the figures out")
    arguments.add_argument("--out", type=Path, default=Path("out/aircraft_gyros"), help="folder of the figures")
    given = arguments.parse_args()

    rows = trim()
    flight = gb.fly(aircraft="gtm", excitation="dissertation", duration_s=500, seed=1)
    identified, threshold_record, healthy = (gb.measure(flight, snr=50, seed=seed) for seed in (1, 1001, 2001))
    operator = identify(identified)
    rows += [markov_parameters(operator), prediction(operator, healthy)]
    norm = gb.windowed_norm(gb.residual(operator, threshold_record), window=WINDOW)
    limit = gb.threshold(norm, start_s=200, end_s=480, factor=1.5)
    reference = flight.between(25, 300)
    for channel in ("p", "q", "r"):
        rms = float(np.std(reference[channel]))  # the deadzone's width isn't printed: half of the RMS
        for broken, figure in (
            (gb.Drift(channel=channel, onset_s=ONSET_S, slope=0.05), "4.3"),
            (gb.Deadzone(channel=channel, onset_s=ONSET_S, half_width=0.5 * rms), "4.4"),
        ):
            rows.append(fault(operator, healthy, limit, broken, figure))
    rows.append(excitation_dependence())
    if not given.quick:
        given.out.mkdir(parents=True, exist_ok=True)
        study = gb.run_study([gb.load_scenario("drift"), gb.load_scenario("deadzone")])
        print("figures:", ", ".join(str(path) for path in write_figures(study, given.out)))
    print(f"{sum(rows)} of {len(rows)} agree")
    return 0 if all(rows) else 1


if __name__ == "__main__":
    sys.exit(main())
