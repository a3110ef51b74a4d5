"""Section 4.3 of the dissertation, last paragraph: the number of excitations; and, beyond it, the choice of r and d.

Run ``python experiments/choices.py [--quick] [--out DIR]``. Sensors of random plants are driven by one, two and three
broadband excitations, and as many must be counted; for a flight with multisine, turbulence and the T2's noise the
orders are chosen on held-out data. It draws ``excitations.png`` and ``orders.png`` into DIR and ends with code 1 where
a count is wrong.
"""

from __future__ import annotations

import sys

import numpy as np
import scipy.signal

import gtmbench as gb
from dissertation.reproduction import Reproduction, reproduce
from gtmbench.report.figures.plot import excitation_figure, order_figure

SENSORS, SAMPLES, SNR, ORDER = 6, 4000, 100, 20


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


def count(page: Reproduction, excitations: int, seeds: range) -> gb.ExcitationCount:
    """Count the excitations of several plants, and return the last count."""
    choices = [
        gb.count_excitations(record, channels=record.channels, causal_order=ORDER, noncausal_order=ORDER)
        for record in (driven(excitations, seed) for seed in seeds)
    ]
    counted = [choice.excitations for choice in choices]
    right = counted.count(excitations)
    page.unprinted(
        f"4.3, {excitations} excitation{'s' if excitations > 1 else ''}, {SENSORS} sensors",
        f"counted as {excitations} in {right} of {len(seeds)} plants",
        holds=right == len(seeds),
        note="plants of our own; the source counts the excitations of the plate and the drum",
        runs=len(seeds),
        values=counted,
    )
    return choices[-1]


def orders() -> gb.OrderChoice:
    """Choose r and d of [p q beta] -> r, on a flight that excites more than one frequency."""
    flight = gb.fly(excitation="multisine+turbulence", duration_s=300, seed=3)
    record = gb.measure(flight, noise="t2", seed=1)
    return gb.select_orders(
        record.between(20, 160), inputs=["p", "q", "beta"], outputs=["r"], validation=record.between(160, 300)
    )


def main(page: Reproduction) -> None:
    """Count, then choose the orders."""
    seeds = range(3 if page.quick else 20)
    counts = [count(page, excitations, seeds) for excitations in (1, 2, 3)]
    choice = orders()
    chosen = {"causal_order": choice.causal_order, "noncausal_order": choice.noncausal_order}
    page.unprinted(
        "4.3, r and d of [p q beta] -> r",
        f"r = {choice.causal_order}, d = {choice.noncausal_order}",
        note=choice.reason,
        values=chosen,
    )
    page.draw("excitations", excitation_figure(counts[1]))
    page.draw("orders", order_figure(choice))


if __name__ == "__main__":
    sys.exit(reproduce(main, __file__, __doc__))
