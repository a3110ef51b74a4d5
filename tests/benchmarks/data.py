"""What is measured on: the flight of the main job, and white noise of any length."""

from __future__ import annotations

from functools import cache

import numpy as np

import gtmbench as gb
from gtmbench.method.problem import Constant

from .problem import Problem

INPUTS, OUTPUTS, R, D = ("p", "q", "beta"), ("r",), 50, 50


@cache
def flight() -> gb.Record:
    """The GTM under the dissertation's excitation: 50,001 samples."""
    return gb.fly(aircraft="gtm", excitation="dissertation", duration_s=500, seed=1)


@cache
def measured(seed: int = 1) -> gb.Record:
    """Its sensors, SNR 50."""
    return gb.measure(flight(), snr=50, seed=seed)


@cache
def stretch() -> gb.Record:
    """The 17,500 samples that the operator is identified on: 17,400 equations."""
    return measured().between(25, 199.99)


def identify(record: gb.Record, constant: Constant = "estimated") -> gb.Transmissibility:
    """The whole public call: 303 parameters and a constant."""
    return gb.identify(record, inputs=INPUTS, outputs=OUTPUTS, causal_order=R, noncausal_order=D, constant=constant)


def problem() -> Problem:
    """The same as arrays, their means removed."""
    u, y = stretch().matrix(INPUTS), stretch().matrix(OUTPUTS)[:, 0]
    return Problem(u - u.mean(axis=0), y - y.mean(), R, D)


def noise(samples: int) -> gb.Record:
    """White noise u, and y that follows it: determined at any number of taps."""
    u, error = np.random.default_rng(1).standard_normal((2, samples))
    return gb.Record(np.column_stack([u, 0.5 * u + 0.1 * error]), channels=["u", "y"], sample_period_s=0.01)
