"""The same flight on every machine: whatever kernels BLAS picks, whatever instructions the CPU has."""

import hashlib
import io
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gtmbench.bench import stepping as flight_module
from gtmbench.bench.engine import ACCELERATIONS, engine, set_condition
from gtmbench.bench.equilibrium import TOLERANCE, trimmed_engine
from gtmbench.bench.flight import fly
from gtmbench.bench.known_aircraft import load_aircraft
from gtmbench.bench.sensors import measure
from tests.helpers.night import by_day

KERNELS = ["Prescott", "Nehalem", "Sandybridge", "Haswell", "Zen", "SkylakeX"]
NEEDS = {"Sandybridge": "avx", "Haswell": "fma", "Zen": "fma", "SkylakeX": "avx512f"}
FLY = """
import sys, numpy as np
from gtmbench.bench.flight import fly
from gtmbench.bench.sensors import measure
flight = fly(excitation="multisine+turbulence", duration_s=60.0, seed=4)
np.save(sys.stdout.buffer, np.hstack([flight.values, measure(flight, snr=50.0, seed=4).values]))
"""
WITHOUT_FMA = {
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F",  # of sin, cos, exp and pow, in JSBSim and Python
    "NPY_DISABLE_CPU_FEATURES": "X86_V3,X86_V4",  # of NumPy's own sin and cos
}


def flown_elsewhere(**variables):
    """Return the flight, and what is measured of it, of a process with other environment variables."""
    done = subprocess.run([sys.executable, "-c", FLY], capture_output=True, check=True, env={**os.environ, **variables})
    return np.load(io.BytesIO(done.stdout))


def has(feature):
    told = Path("/proc/cpuinfo")
    return told.exists() and feature in told.read_text().split()


@pytest.fixture(scope="module")
def here():
    flight = fly(excitation="multisine+turbulence", duration_s=60.0, seed=4)
    return np.hstack([flight.values, measure(flight, snr=50.0, seed=4).values])


@pytest.mark.nightly
@pytest.mark.parametrize("kernel", by_day(KERNELS))
def test_every_kernel_of_openblas_flies_the_same_bits(here, kernel):
    if kernel in NEEDS and not has(NEEDS[kernel]):
        pytest.skip(f"this CPU can't run {kernel}'s kernels")
    there = flown_elsewhere(OPENBLAS_CORETYPE=kernel)
    assert hashlib.sha256(there.tobytes()).hexdigest() == hashlib.sha256(here.tobytes()).hexdigest()


@pytest.mark.nightly
def test_a_cpu_without_fma_flies_the_same_to_a_billionth(here):
    there = flown_elsewhere(**WITHOUT_FMA)
    # relative where values are large: JSBSim's altitude is a difference of radii, which end at 3.7e-9 ft
    np.testing.assert_allclose(there, here, rtol=1e-9, atol=1e-9)


@pytest.mark.skipif(not has("fma"), reason="nothing to turn off")
def test_fma_can_be_turned_off():
    """Or the test above compares a thing with itself."""
    sines = "import math; print([f(0.0007 * k).hex() for k in range(20000) for f in (math.sin, math.tan, math.exp)])"
    told = {
        subprocess.run(
            [sys.executable, "-c", sines], capture_output=True, text=True, check=True, env={**os.environ, **other}
        ).stdout
        for other in ({}, WITHOUT_FMA)
    }
    if len(told) == 1:
        pytest.skip("this C library knows no such tunables")


def test_a_flight_depends_on_its_trim_without_jumps(monkeypatch):
    """Gusts once took their direction from the last bits of the trim: any change made another flight."""
    reference = fly(excitation="turbulence", duration_s=20.0, seed=4)
    for change in (1e-13, 1e-11, 1e-9):

        def nudged(craft, change=change, **_):
            _, trim = trimmed_engine(craft)
            at = {"altitude": trim.altitude_ft, "tas": craft.tas_kt, "psi": trim.yaw_deg, "beta": 0.0}
            at |= {"alpha": trim.alpha_deg + change, "phi": trim.roll_deg, "theta": trim.pitch_deg, **trim.commands}
            fdm = engine(craft)
            set_condition(fdm, craft, at)
            return fdm, trim

        monkeypatch.setattr(flight_module, "trimmed_engine", nudged)
        flight = fly(excitation="turbulence", duration_s=20.0, seed=4)
        rates = ("p", "q", "r", "phi", "theta", "psi")
        assert np.abs(flight.matrix(rates) - reference.matrix(rates)).max() < 1e-11 + 10.0 * change


def test_rounded_unknowns_still_trim():
    for tas_kt in (85.0, 100.58, 130.0):
        fdm, trim = trimmed_engine(load_aircraft("gtm"), tas_kt=tas_kt)
        unknowns = (trim.alpha_deg, trim.roll_deg, *trim.commands.values())
        assert unknowns == tuple(round(value, 8) for value in unknowns)
        assert max(abs(fdm[name]) for name in ACCELERATIONS) < TOLERANCE


def test_a_condition_leaves_no_trace_of_the_one_before():
    """What a search has tried before decides nothing: attitude and accelerations are those of a fresh engine."""
    craft = load_aircraft("gtm")
    fdm, trim = trimmed_engine(craft)
    at = {"altitude": trim.altitude_ft, "tas": craft.tas_kt, "psi": trim.yaw_deg, "beta": 0.0}
    at |= {"alpha": trim.alpha_deg, "phi": trim.roll_deg, "theta": trim.pitch_deg, **trim.commands}
    names = [*ACCELERATIONS, *(f"attitude/{angle}-deg" for angle in ("phi", "theta", "psi")), "aero/alpha-deg"]
    fresh = [fdm[name] for name in names]
    set_condition(
        fdm, craft, at | {"alpha": 8.0, "phi": 20.0, "psi": 10.0, "beta": 3.0, "altitude": 3000.0, "tas": 80.0}
    )
    set_condition(fdm, craft, at)
    np.testing.assert_allclose([fdm[name] for name in names], fresh, rtol=0.0, atol=1e-11)
