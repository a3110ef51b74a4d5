"""The gallery of faults: every kind on the same 20 s of a flight of the GTM, healthy in grey, broken in colour.

Run ``python experiments/fault_gallery.py [--out DIR]``; it draws ``fault_gallery.png`` for `docs/reference/faults.md`.
Panels stand as the files of `gtmbench/faults` do: what is added, how the signal is shaped, what takes its place; then
two ways in which any of them may come. A new kind wants an entry in `SHOWN`.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

import gtmbench as gb
from gtmbench.faults.kinds import additive, replacing, shaping
from gtmbench.faults.registry import FAULTS
from gtmbench.files.disk import atomic_write
from gtmbench.report.figures.panels import panels
from gtmbench.report.words.judgement import fault_text

CHANNEL, NEIGHBOUR = "p", "q"
BEGIN_S, LENGTH_S, ONSET_S = 60.0, 20.0, 5.0  # into the flight, of the picture, and into the picture
COLUMNS = 5
COLOURS = {additive: "#d62728", shaping: "#1f5fa8", replacing: "#b8621b"}
SHOWN: dict[str, dict[str, Any]] = {  # severities that one sees at this size
    "bias": {"size": 20.0},
    "drift": {"slope": 2.0},
    "random_walk": {"gain": 6.0, "seed": 2},
    "oscillation": {"amplitude": 12.0, "frequency_hz": 1.5},
    "noise": {"deviation": 6.0},
    "spikes": {"size": 30.0, "rate_hz": 1.0},
    "g_sensitivity": {"axis": "nz", "coefficient": 20.0},
    "scale_factor": {"factor": 1.6},
    "sign_flip": {},
    "misalignment": {"axis": NEIGHBOUR, "angle_deg": 60.0},
    "deadzone": {"half_width": 10.0},
    "saturation": {"limit": 12.0},
    "rate_saturation": {"rate_limit": 25.0},
    "hysteresis": {"width": 20.0},
    "quantisation": {"quantum": 12.0},
    "lag": {"lag_s": 0.5},
    "dropout": {},
    "stuck": {},
    "jam": {},
    "hardover": {"limit": 50.0, "rate_limit": 25.0},
    "stale": {"hold_s": 1.0},
    "delay": {"delay_s": 0.6},
    "swap": {"other": NEIGHBOUR},
    "float": {"flow": NEIGHBOUR, "ratio": 1.5},
}


def faults() -> dict[str, gb.Fault]:
    """Return what is drawn, panel by panel, by titles."""
    where = {"channel": CHANNEL, "onset_s": BEGIN_S + ONSET_S}
    kinds = [kind for family in COLOURS for kind in SHOWN if FAULTS[kind].__module__ == family.__name__]
    shown = [FAULTS[kind](**where, **SHOWN[kind]) for kind in kinds]
    told = {fault_text(fault).replace(f" of {CHANNEL}", ""): fault for fault in shown}
    times = gb.Intermittent(period_s=4.0, duty=0.4, jitter=0.4, seed=3)
    told["intermittent: jam, 4 s, 40 %"] = gb.Jam(**where, intermittent=times)
    told["ramp of 10 s: bias, 20 deg/s"] = gb.Bias(**where, size=20.0, ramp_s=10.0)
    return told


def draw(axis: Axes, title: str, fault: gb.Fault, healthy: gb.Record) -> None:
    """Draw a channel as it should be and as the fault has it."""
    time_s = healthy.time_s - BEGIN_S
    family = next((colour for module, colour in COLOURS.items() if type(fault).__module__ == module.__name__), "k")
    axis.plot(time_s, healthy[CHANNEL], color="#a8a8a8", lw=1.0)
    begun = time_s >= ONSET_S - 1e-9
    broken = gb.inject(healthy, fault)[CHANNEL][begun]
    axis.plot(time_s[begun], broken, color=family, lw=1.0)
    if not np.isfinite(broken).any():
        axis.text(0.5 * (ONSET_S + LENGTH_S), 40.0, "no readings", color=family, fontsize=9, ha="center")
    axis.axvline(ONSET_S, color="k", lw=0.8, ls=":")
    axis.set_title(title, fontsize=9, loc="left", color=family)
    axis.set_xlim(0.0, LENGTH_S)
    axis.set_ylim(-60.0, 60.0)
    axis.set_xticks([0, 5, 10, 15, 20])
    axis.set_yticks([-50, 0, 50])
    axis.tick_params(labelsize=8)
    axis.label_outer()


def main() -> None:
    """Fly, break and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/experiments/fault_gallery"), help="folder of the picture")
    out: Path = parser.parse_args().out
    flight = gb.fly(excitation="multisine", duration_s=BEGIN_S + LENGTH_S, seed=1)
    healthy = gb.measure(flight, noise="t2", seed=1).between(BEGIN_S, BEGIN_S + LENGTH_S)
    shown = faults()
    rows = -(-len(shown) // COLUMNS)
    figure, axes = panels(rows, COLUMNS, (13.0, 2.1 * rows))
    places = [axis for row in axes for axis in row]
    for axis, (title, fault) in zip(places, shown.items(), strict=False):
        draw(axis, title, fault, healthy)
    for axis in places[len(shown) :]:
        axis.set_visible(False)
    figure.supxlabel("time (s)", fontsize=10)
    figure.supylabel(f"{CHANNEL} (deg/s)", fontsize=10)
    out.mkdir(parents=True, exist_ok=True)
    with atomic_write(out / "fault_gallery.png") as aside:
        figure.savefig(aside, dpi=90)
    print(f"{len(shown)} panels: {out / 'fault_gallery.png'}")


if __name__ == "__main__":
    main()
