"""The gallery of faults: every kind on the same 20 s of a flight of the GTM, healthy in grey, broken in colour.

Run ``python experiments/fault_gallery.py [--out DIR]``; it draws ``fault_gallery.png`` for `docs/reference/faults.md`.
Panels stand as the files of `gtmbench/faults` do: what is added, how the signal is shaped, what takes its place; then
two ways in which any of them may come. A class says what is shown of it (`Typical`).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

import gtmbench as gb
from gtmbench.faults.kinds import additive, replacing, shaping
from gtmbench.faults.registry import FAULTS
from gtmbench.files.writing import atomic_write
from gtmbench.report.figures.panels import panels
from gtmbench.report.words.judgement import fault_text

CHANNEL = "p"
BEGIN_S, LENGTH_S, ONSET_S = 60.0, 20.0, 5.0  # into the flight, of the picture, and into the picture
COLUMNS = 5
COLOURS = {additive: "#d62728", shaping: "#1f5fa8", replacing: "#b8621b"}


def faults() -> dict[str, gb.Fault]:
    """Return what is drawn, panel by panel, by titles."""
    where = {"channel": CHANNEL, "onset_s": BEGIN_S + ONSET_S}
    classes = sorted((cls for cls in FAULTS.values() if cls.typical is not None), key=_place)
    shown = [cls(**where, **cls.typical.shown) for cls in classes if cls.typical is not None]
    told = {fault_text(fault).replace(f" of {CHANNEL}", ""): fault for fault in shown}
    times = gb.Intermittent(period_s=4.0, duty=0.4, jitter=0.4, seed=3)
    told["intermittent: jam, 4 s, 40 %"] = gb.Jam(**where, intermittent=times)
    told["ramp of 10 s: bias, 20 deg/s"] = gb.Bias(**where, size=20.0, ramp_s=10.0)
    return told


def _place(cls: type[gb.Fault]) -> int:
    """Return where a kind stands: by its file; one of its own comes last."""
    files = [family.__name__ for family in COLOURS]
    return files.index(cls.__module__) if cls.__module__ in files else len(files)


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
