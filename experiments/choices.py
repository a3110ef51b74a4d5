"""Section 4.3 of the dissertation, last paragraph: the number of excitations; and, beyond it, the choice of r and d.

Run ``python experiments/choices.py [--quick] [--out DIR]``. Sensors of random plants are driven by one, two and three
broadband excitations, and as many must be counted; for a flight with multisine, turbulence and the T2's noise the
orders are chosen on held-out data. It draws ``excitations.png`` and ``orders.png`` into DIR (not with ``--quick``) and
ends with code 1 where a count is wrong.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import scipy.signal

import gtmbench as gb
from gtmbench.report.selection import excitation_figure, order_figure

SENSORS, SAMPLES, SNR, ORDER = 6, 4000, 100, 20


def check(name: str, expected: str, ours: str, agrees: bool) -> bool:
    """Print one row: what should come out, what came out."""
    print(f"{name:<42} {expected:>24} {ours:>22}   {'agrees' if agrees else 'DISAGREES'}")
    return agrees


def driven(excitations: int, seed: int) -> gb.Record:
    """Return sensors of a plant with one damped mode; a sensor has zeros of its own for every excitation."""
    rng = np.random.default_rng([seed, excitations])
    sources = rng.standard_normal((excitations, SAMPLES))
    poles = np.poly([0.8 * np.exp(0.5j), 0.8 * np.exp(-0.5j)]).real
    sensors = []
    for _ in range(SENSORS):
        zeros = rng.uniform(0.2, 0.8, excitations) ** rng.choice([-1, 1], excitations)  # on either side of the circle
        heard = [
            scipy.signal.lfilter([1.0, -zero], poles, u) / (1.0 + zero) for u, zero in zip(sources, zeros, strict=True)
        ]
        sensors.append(np.sum(heard, axis=0))
    values = np.column_stack(sensors)
    values += rng.standard_normal(values.shape) * values.std(axis=0) / SNR
    return gb.Record(values, channels=[f"s{i}" for i in range(SENSORS)], sample_period_s=0.01)


def count(excitations: int, seeds: range) -> tuple[bool, gb.ExcitationCount]:
    """Count the excitations of several plants, and return the last count."""
    found = [
        gb.count_excitations(record, channels=record.channels, causal_order=ORDER, noncausal_order=ORDER)
        for record in (driven(excitations, seed) for seed in seeds)
    ]
    right = sum(one.excitations == excitations for one in found)
    name = f"4.3, {excitations} excitation{'s' if excitations > 1 else ''}, {SENSORS} sensors"
    return check(name, f"{excitations} in {len(seeds)} plants", f"in {right}", right == len(seeds)), found[-1]


def orders() -> gb.OrderChoice:
    """Choose r and d of [p q beta] -> r, on a flight that excites more than one frequency."""
    flight = gb.fly(excitation="multisine+turbulence", duration_s=300, seed=3)
    record = gb.measure(flight, noise="t2", seed=1)
    return gb.select_orders(
        record.between(20, 160), inputs=["p", "q", "beta"], outputs=["r"], validation=record.between(160, 300)
    )


def main() -> int:
    """Print every count and, with figures, the orders."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer plants, no figures")
    parser.add_argument("--out", type=Path, default=Path("choices"), help="folder of the figures (default: choices)")
    given = parser.parse_args()
    seeds = range(3 if given.quick else 20)
    rows, counts = zip(*(count(excitations, seeds) for excitations in (1, 2, 3)), strict=True)
    choice = orders()
    print("orders:", choice.reason)
    if not given.quick:
        given.out.mkdir(parents=True, exist_ok=True)
        excitation_figure(counts[1]).savefig(given.out / "excitations.png", dpi=130)
        order_figure(choice).savefig(given.out / "orders.png", dpi=130)
        print("figures:", given.out / "excitations.png,", given.out / "orders.png")
    print(f"{sum(rows)} of {len(rows)} agree")
    return 0 if all(rows) else 1


if __name__ == "__main__":
    sys.exit(main())
