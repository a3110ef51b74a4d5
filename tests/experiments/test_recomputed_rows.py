"""Five rows of the dissertation's table, held to 1e-9 against what numpy and mpmath alone make of its equations."""

import json
import subprocess
import sys

import numpy as np
import pytest

import gtmbench as gb
from tests.helpers import recomputed
from tests.helpers.night import by_day
from tests.helpers.scripts import EXPERIMENTS

AGREE = 1e-9


def committed(script, result):
    """Return the values of a row."""
    page = json.loads((EXPERIMENTS / "reports" / script / "results.json").read_text())
    (row,) = [row for row in page["rows"] if row["result"].startswith(result)]
    return row["values"]


def test_nothing_of_gtmbench_is_imported():
    code = "import sys, runpy; runpy.run_path(sys.argv[1]); print([n for n in sys.modules if n.startswith('gtmbench')])"
    told = subprocess.run(
        [sys.executable, "-c", code, recomputed.__file__], capture_output=True, text=True, check=True, cwd="/"
    )
    assert told.stdout.strip() == "[]"


@pytest.mark.nightly
def test_3_55_has_determinant_1_and_singular_values_that_no_record_tells_from_0():
    least = recomputed.moments_of_3_55()
    np.testing.assert_allclose(
        committed("closed_loop", "(3.55), A1) with its lags")["least singular values"], least, AGREE
    )
    assert 3e-28 < least[0] < 4e-28


@pytest.fixture(scope="module")
def flown():
    """Return what is identified on, and what is predicted."""
    flight = gb.fly(aircraft="gtm", excitation="dissertation", duration_s=500, seed=1)
    return [gb.measure(flight, snr=50, seed=seed).matrix(["p", "q", "beta", "r"]) for seed in (1, 2001)]


@pytest.mark.parametrize("constant", by_day(["estimated", "records", "none"], 0))
def test_4_9_and_fig_4_2_by_their_constant(flown, constant):
    identified, healthy = flown
    rms, share = recomputed.error_of_fig_4_2(identified[2500:20_001], healthy, range(28_000, 28_501), 50, constant)
    ours = committed("aircraft_gyros", "(4.9), residual by its constant")
    assert ours["residual"][constant] == pytest.approx(rms, rel=AGREE)
    assert ours["Fig. 4.2"][constant] == pytest.approx(share, rel=AGREE)
    if constant == "estimated":
        assert committed("aircraft_gyros", "Fig. 4.2") == pytest.approx(share, rel=AGREE)


def test_5_103_coefficient_by_coefficient():
    assert committed("structures", "(5.103), T^F") == recomputed.operator_5_103()


def test_5_115_as_ours_is():
    for ours, again in zip(committed("beam", "(5.115), coefficients"), recomputed.operator_5_115(7850), strict=True):
        np.testing.assert_allclose(ours, again, rtol=AGREE, atol=0)


def test_6_29_of_the_five_examples():
    np.testing.assert_allclose(committed("hammerstein", "(6.29), factors"), recomputed.factors_6_29(), rtol=AGREE)
