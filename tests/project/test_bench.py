"""The committed figures of `make bench` meet their targets, and the documentation shows them as they are."""

import json
import operator
import tomllib

import numpy as np
import pytest

import gtmbench as gb
from tests.benchmarks.problem import Problem
from tests.benchmarks.results import BENCH, ROOT, block_of_the_page
from tests.benchmarks.solvers import SOLVERS, numpy_lstsq
from tests.benchmarks.table import TARGETS, block

SIGNS = {">=": operator.ge, "<=": operator.le}


@pytest.fixture(scope="module")
def results():
    return json.loads(BENCH.read_text())


@pytest.mark.parametrize(("section", "key"), TARGETS)
def test_the_committed_figure_meets_its_target(results, section, key):
    sign, bound = TARGETS[section, key]
    figure = results[section][key]
    assert SIGNS[sign](figure, bound), f"{section}.{key} is {figure:g}, wanted {sign} {bound:g}; run make bench"


def test_every_section_and_every_peer_is_there(results):
    assert set(results) == {
        "machine",
        "identification",
        "fresh",
        "commands",
        "peers",
        "residual",
        "norm",
        "flight",
        "growth",
    }
    assert set(results["peers"]) == set(SOLVERS)
    for name, row in results["peers"].items():
        assert row["note"], name
        assert "failed" in row or row["ratio"] > 0, name


def test_the_documentation_shows_the_committed_figures(results):
    assert block_of_the_page() == block(results)


def test_a_peer_is_in_the_extra_or_has_its_own_environment():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    pinned = {line.split("==")[0] for line in (ROOT / "constraints.txt").read_text().split()}
    here = {solver.package for solver in SOLVERS.values() if not solver.environment} - {"numpy", "scipy"}
    assert set(project["optional-dependencies"]["bench"]) == here
    assert here <= pinned


def test_solvers_and_gtmbench_are_given_the_same_problem():
    u, error = np.random.default_rng(1).standard_normal((2, 2000, 2))
    y = 2.0 * u[:, 0] + np.roll(u[:, 1], -1) + 0.1 * error[:, 0]
    record = gb.Record(np.column_stack([u, y]), channels=["a", "b", "y"], sample_period_s=0.01)
    names = {"inputs": ["a", "b"], "outputs": ["y"], "causal_order": 3, "noncausal_order": 2}
    fit = gb.identify(record, constant="records", **names)
    problem = Problem(u - u.mean(axis=0), y - y.mean(), 3, 2)
    assert numpy_lstsq(problem)() == pytest.approx(fit.markov[:, 0, :], abs=1e-12)

    # samples instead of a regressor: on the late output, with a sample of padding, lags 1..6 give the same equations
    late, padded = problem.delayed(), np.pad(problem.inputs, ((0, 1), (0, 0)))
    causal = Problem(padded, late, 6, 0)
    assert np.array_equal(causal.target(), problem.target())
    assert np.array_equal(causal.regressor()[:, 2:], problem.regressor())
