"""Section 4.4 of the dissertation, step by step: application to aircraft sensor health monitoring.

Run ``python experiments/aircraft_gyros.py [--quick] [--out DIR]``. It prints its numbers beside the printed ones and
draws the counterparts of Figs. 4.1-4.4 into DIR; it ends with code 1 where they disagree.
"""

from __future__ import annotations

import sys

import numpy as np

import gtmbench as gb
from gtmbench.report.dissertation.reproduction import Reproduction, reproduce
from gtmbench.report.figures.study import write_figures

# what is printed, with the tolerance at which the model is held to it: name -> (value, tolerance)
PRINTED_TRIM = {
    "altitude_ft": (8000.00, 0.01),
    "eas_kt": (89.18, 0.05),
    "tas_kt": (100.58, 0.01),
    "alpha_deg": (3.00, 0.05),
    "beta_deg": (0.0, 0.01),
    "gamma_deg": (0.0, 0.01),
    "roll_deg": (0.066, 0.1),
    "pitch_deg": (3.00, 0.05),
    "yaw_deg": (45.00, 0.01),
    "ground_track_deg": (45.00, 0.01),
    "elevator_deg": (2.70, 0.15),
    "throttle_percent": (22.84, 2.5),
}
ONSET_S, WINDOW, R, D = 300.0, 1000, 50, 50


def trim(page: Reproduction) -> None:
    """Trim: level flight at 8000 ft and 100.58 kt."""
    trimmed = gb.trim("gtm")
    notes = {
        "roll_deg": "a balance of hundredths of a degree: `aircraft/gtm/README.md`",
        "throttle_percent": "the thrust model isn't the source's",
    }
    for name, (printed, tolerance) in PRINTED_TRIM.items():
        ours, note = getattr(trimmed, name), notes.get(name, "")
        page.number(f"4.4, trim, {name}", printed, ours, tolerance=tolerance, note=note)


def identify(record: gb.Record) -> gb.Transmissibility:
    """(4.13): the operator [p q beta] -> r, by PEM with a noncausal FIR model, 2,500 <= k <= 20,000."""
    return gb.identify(
        record.between(25, 200), inputs=["p", "q", "beta"], outputs=["r"], causal_order=R, noncausal_order=D
    )


def markov_parameters(page: Reproduction, operator: gb.Transmissibility) -> None:
    """Entries of the Markov parameters (Fig. 4.1): r + d + 1 lags of a 1 x 3 operator."""
    lags, outputs, inputs = operator.markov.shape
    agrees = (lags, outputs, inputs) == (R + D + 1, 1, 3)
    ours = f"{lags} of {outputs} x {inputs}"
    page.claim("Fig. 4.1, Markov parameters", "101 of 1 x 3", ours, agrees=agrees, values=operator.markov)


def prediction(page: Reproduction, operator: gb.Transmissibility, record: gb.Record) -> None:
    """One-step prediction of r, 28,000 <= k <= 28,500 (Fig. 4.2): the lines of the figure lie on each other."""
    shown = slice(28_000, 28_501)
    error = record["r"][shown] - operator.predict(record)[shown, 0]
    share = float(np.sqrt(np.mean(error**2)) / np.std(record["r"]))
    ours = f"{share:.3f} (RMS)"
    page.claim("Fig. 4.2, error of the prediction over r", "small", ours, agrees=share < 0.1, values=share)


def fault(
    page: Reproduction,
    operator: gb.Transmissibility,
    healthy: gb.Record,
    limit: float,
    broken: gb.Fault,
    figure: str,
) -> None:
    """Figs. 4.3, 4.4: the residual's norm E(k), (4.12), increases after t = 300 s."""
    norms = [
        gb.windowed_norm(gb.residual(operator, record), window=WINDOW)
        for record in (healthy, gb.inject(healthy, broken))
    ]
    before = norms[0].time_s + (WINDOW + D) * healthy.sample_period_s < ONSET_S
    unchanged = np.array_equal(norms[0].values[before], norms[1].values[before], equal_nan=True)
    ratio = float(np.nanmax(norms[1].values[~before]) / limit)
    page.claim(
        f"Fig. {figure}, {broken.kind} of {broken.channel}",
        "E rises after 300 s",
        f"to {ratio:.1f} thresholds",
        agrees=unchanged and ratio > 1.0,
        note="width missing: half of the RMS" if isinstance(broken, gb.Deadzone) else "",
        values=ratio,
    )


def excitation_dependence(page: Reproduction) -> None:
    """Not in the dissertation: an operator identified on one sinusoid, asked about a multisine flight (T2 noise)."""
    flown = ("dissertation", "multisine")
    records = [gb.measure(gb.fly(excitation=name, seed=1), noise="t2", seed=1) for name in flown]
    operator = identify(records[0])
    own, other = (
        float(np.sqrt(np.mean(gb.residual(operator, record).values[20_000:48_001] ** 2))) for record in records
    )
    page.unprinted(
        "4.4, residual on its own and another flight",
        f"{own:.2f} and {other:.1f} deg/s",
        note="one sinusoid ties the operator to its excitation",
        values=[own, other],
    )


def main(page: Reproduction) -> None:
    """Run every step of section 4.4."""
    trim(page)
    flight = gb.fly(aircraft="gtm", excitation="dissertation", duration_s=500, seed=1)
    identified, threshold_record, healthy = (gb.measure(flight, snr=50, seed=seed) for seed in (1, 1001, 2001))
    operator = identify(identified)
    markov_parameters(page, operator)
    prediction(page, operator, healthy)
    norm = gb.windowed_norm(gb.residual(operator, threshold_record), window=WINDOW)
    limit = gb.threshold(norm, start_s=200, end_s=480, factor=1.5)
    reference = flight.between(25, 300)
    for channel in ("p", "q", "r"):
        rms = float(np.std(reference[channel]))
        for broken, figure in (
            (gb.Drift(channel=channel, onset_s=ONSET_S, slope=0.05), "4.3"),
            (gb.Deadzone(channel=channel, onset_s=ONSET_S, half_width=0.5 * rms), "4.4"),
        ):
            fault(page, operator, healthy, limit, broken, figure)
    excitation_dependence(page)
    study = gb.run_study([gb.load_scenario("drift"), gb.load_scenario("deadzone")])
    page.figures += [path.name for path in write_figures(study, page.folder)]


if __name__ == "__main__":
    sys.exit(reproduce(main, __file__, __doc__))
