"""Choosing r and d: what made the data is chosen, and every figure is what a separate identification finds."""

import itertools

import numpy as np
import pandas as pd
import pytest

import gtmbench as gb
from gtmbench.errors import InputError
from gtmbench.method.selection.orders import ORDERS, _choice
from gtmbench.report.figures.plot import order_figure
from tests.helpers.oracles import sampled

INPUTS, OUTPUTS = ["u1", "u2"], ["y1", "y2"]
CAUSAL, NONCAUSAL = [0, 1, 3, 6], [0, 2, 5]


def fir(seed=0, *, samples=600, r=3, d=2, noise=0.1, rest=0):
    """Return a record of two inputs and two outputs, FIR of orders r and d plus noise; `rest` zeros at both ends."""
    rng = np.random.default_rng([7, seed])
    markov = rng.uniform(0.5, 1.5, (r + d + 1, 2, 2)) * rng.choice([-1.0, 1.0], (r + d + 1, 2, 2))
    u = rng.standard_normal((samples, 2))
    y = sum(np.roll(u, i, axis=0) @ markov[i + d].T for i in range(-d, r + 1))
    both = np.column_stack([u, y + noise * rng.standard_normal(y.shape)])
    both = both - both.mean(axis=0)
    return sampled(np.pad(both, ((rest, rest), (0, 0))), [*INPUTS, *OUTPUTS])


def orders(record, **changes):
    asked = {"inputs": INPUTS, "outputs": OUTPUTS, "causal_orders": CAUSAL, "noncausal_orders": NONCAUSAL}
    return gb.select_orders(record, **{**asked, **changes})


def separately(record, r, d, largest=(CAUSAL[-1], NONCAUSAL[-1])):
    """Identify one member on the equations of the largest: what lies outside is at rest, so the means stay the same."""
    part = slice(largest[0] - r, len(record) - (largest[1] - d))
    cut = sampled(record.values[part], record.channels)
    return gb.identify(cut, inputs=INPUTS, outputs=OUTPUTS, causal_order=r, noncausal_order=d)


def test_nested_members_are_what_separate_identifications_find():
    record, other = fir(1, rest=11), fir(2, rest=11)
    table = orders(record, validation=other).table.set_index(["causal_order", "noncausal_order"])
    assert len(table) == len(CAUSAL) * len(NONCAUSAL)
    for (r, d), row in table.iterrows():
        operator = separately(record, r, d)
        np.testing.assert_allclose(row[["rms_y1", "rms_y2"]], operator.rms_residual, rtol=1e-9)
        assert row["parameters"] == row["rank"] == operator.rank
        left = gb.residual(operator, other).values[CAUSAL[-1] : len(other) - NONCAUSAL[-1]]
        np.testing.assert_allclose(row[["heldout_y1", "heldout_y2"]], np.sqrt(np.mean(left**2, axis=0)), rtol=1e-9)
        relative = left / record.matrix(OUTPUTS).std(axis=0)
        assert row["heldout"] == pytest.approx(np.sqrt(np.mean(relative**2)), rel=1e-9)


def test_the_criteria_are_those_of_gaussian_residuals():
    record = fir(1)
    table = orders(record).table
    n = len(record) - CAUSAL[-1] - NONCAUSAL[-1]
    fit = n * np.log(table[["rms_y1", "rms_y2"]] / record.matrix(OUTPUTS).std(axis=0)).sum(axis=1) * 2.0
    np.testing.assert_allclose(table["aic"], fit + 4.0 * table["parameters"], rtol=1e-12)
    np.testing.assert_allclose(table["bic"], fit + 2.0 * np.log(n) * table["parameters"], rtol=1e-12)


@pytest.mark.parametrize("noise", [0.0, 0.1, 1.0])
@pytest.mark.parametrize(("r", "d"), [(0, 0), (3, 2), (5, 0), (0, 4)])
def test_the_orders_that_made_the_data_are_recommended(r, d, noise):
    grid = {"causal_orders": range(8), "noncausal_orders": range(8)}
    records = [fir(seed, samples=3000, r=r, d=d, noise=noise, rest=20) for seed in (3, 3, 4)]
    by_bic = orders(records[0], **grid)
    assert (by_bic.causal_order, by_bic.noncausal_order) == (r, d)
    assert "least BIC of 64 models" in by_bic.reason
    rng = np.random.default_rng(0)
    noisy = records[1].values + noise * rng.standard_normal(records[1].values.shape) * [0, 0, 1, 1]
    held = orders(records[0], validation=sampled(noisy, records[0].channels), **grid)
    assert (held.causal_order, held.noncausal_order) == (r, d)
    assert "held-out" in held.reason or "held out" in held.reason


def test_a_surface_is_one_gram_matrix_and_one_for_validation(grams):
    record = fir(1)
    orders(record)
    assert len(grams) == 1
    orders(record, validation=fir(2))
    assert len(grams) == 3


def test_units_offsets_and_the_order_of_names_dont_change_the_choice():
    record, scale = fir(1), np.array([1e6, 1e-3, 1e-6, 50.0])
    choice = orders(record, validation=fir(2))
    scaled = [sampled(part.values * scale + 7.0 * scale, part.channels) for part in (record, fir(2))]
    other = orders(scaled[0], validation=scaled[1], inputs=INPUTS[::-1], outputs=OUTPUTS[::-1])
    assert (choice.causal_order, choice.noncausal_order) == (other.causal_order, other.noncausal_order)
    np.testing.assert_allclose(other.table["rms_y2"], choice.table["rms_y2"] * 50.0, rtol=1e-9)
    for name in ("aic", "bic", "heldout"):
        np.testing.assert_allclose(other.table[name], choice.table[name], rtol=1e-9)


def test_one_order_is_a_grid_too():
    choice = orders(fir(1), causal_orders=3, noncausal_orders=np.arange(2, 3))
    assert (choice.causal_order, choice.noncausal_order, len(choice.table)) == (3, 2, 1)
    causal = orders(fir(1), causal_orders=[0, 1], noncausal_orders=0).reason  # of one that is 0 nothing is said
    assert causal.endswith("; the causal order is the largest tried, so try larger ones")


def test_a_choice_on_the_edge_of_the_grid_says_so():
    assert "try larger" not in orders(fir(1), causal_orders=range(5), noncausal_orders=range(5)).reason
    cut = orders(fir(1), causal_orders=range(3), noncausal_orders=range(5)).reason
    assert cut.endswith("; the causal order is the largest tried, so try larger ones")


def test_several_records_count_as_one():
    first, second = fir(1, rest=20), fir(2, rest=20)
    gap = orders([first, second])
    joined = orders(sampled(np.vstack([first.values, second.values]), first.channels))
    assert (gap.causal_order, gap.noncausal_order) == (joined.causal_order, joined.noncausal_order)
    assert gap.table["rms_y1"].iloc[-1] == pytest.approx(joined.table["rms_y1"].iloc[-1], rel=0.02)


@pytest.mark.filterwarnings("ignore::gtmbench.errors.RankWarning")
def test_data_that_lack_rank_give_the_figures_of_the_shortest_solutions():
    """u2 is u1, doubled: every member lacks rank."""
    record, other = (
        sampled(part.values[:, [0, 0, 2, 3]] * [1, 2, 1, 1], part.channels) for part in (fir(1, rest=11), fir(2))
    )
    table = orders(record, validation=other).table
    assert np.isfinite(table.to_numpy()).all()
    np.testing.assert_array_equal(table["rank"] * 2, table["parameters"])
    for row in table.itertuples():
        operator = separately(record, row.causal_order, row.noncausal_order)
        assert row.rms_y1 == pytest.approx(operator.rms_residual[0], rel=1e-9)
        left = gb.residual(operator, other).values[CAUSAL[-1] : len(other) - NONCAUSAL[-1]]
        assert row.heldout_y1 == pytest.approx(np.sqrt(np.mean(left[:, 0] ** 2)), rel=1e-6)


def test_noise_free_sinusoids_need_no_more_than_what_fits_them():
    angle = 2.0 * np.pi * np.arange(2000) / 50
    values = np.column_stack([np.sin(angle), 2.0 * np.sin(angle + 0.7)])
    record = sampled(values, ["u", "y"])
    choice = gb.select_orders(record, inputs=["u"], outputs=["y"], causal_orders=range(6), noncausal_orders=range(6))
    assert choice.causal_order + choice.noncausal_order == 1
    assert choice.table["rank"].max() == 2


def test_a_surface_is_looked_up_by_its_orders():
    choice = orders(fir(1))
    surface = choice.surface("rms_y2")
    assert surface.index.tolist() == CAUSAL
    assert surface.columns.tolist() == NONCAUSAL
    row = choice.table.iloc[5]
    assert surface.loc[row["causal_order"], row["noncausal_order"]] == row["rms_y2"]
    with pytest.raises(InputError, match="the table has no column 'rms'; it has parameters, rank, rms_y1"):
        choice.surface("rms")


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"causal_orders": []}, "causal_orders holds no order; give at least one"),
        ({"noncausal_orders": [1, -1]}, "noncausal_orders is -1; it must be a whole number, 0 or more"),
        ({"causal_orders": [1.5]}, "causal_orders is 1.5"),
        ({"causal_orders": None}, "causal_orders is None"),
        (
            {"causal_orders": [400]},
            "600 samples of u1, u2 give 195 equations for 812 Markov parameters and a constant of 'y1'",
        ),
        ({"inputs": ["u1", "alpha"]}, "no channel 'alpha'"),
        ({"inputs": ["u1", "y1"]}, "'y1' is both pseudo input and pseudo output"),
        ({"outputs": []}, "at least one pseudo input and one pseudo output"),
        ({"validation": fir(1).select(INPUTS)}, "no channel 'y1', 'y2' in this record"),
        ({"validation": []}, "no record given"),
        ({"validation": sampled(fir(1).values[:10], [*INPUTS, *OUTPUTS])}, "10 samples for validation give no equ"),
        (
            {"validation": gb.Record(np.ones((50, 4)), channels=[*INPUTS, *OUTPUTS], sample_period_s=1)},
            "those to identify on every 0.01 s; resample",
        ),
        ({"validation": sampled(np.full((50, 4), np.nan), [*INPUTS, *OUTPUTS])}, "'u1' has 50 missing samples"),
    ],
    ids=str,
)
def test_what_no_orders_can_be_chosen_from_is_refused(asked, message):
    with pytest.raises(InputError, match=message) as refused:
        orders(fir(1), **asked)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("name", [None, "bic", "rms_y1"])
def test_the_figure_of_a_surface_marks_the_recommendation(name, tmp_path):
    choice = orders(fir(1), validation=fir(2))
    figure = order_figure(choice, name=name)
    figure.savefig(tmp_path / "orders.png")
    (mark,) = figure.axes[0].lines
    at = CAUSAL.index(choice.causal_order), NONCAUSAL.index(choice.noncausal_order)
    assert (mark.get_ydata()[0], mark.get_xdata()[0]) == at


def test_fewer_parameters_are_as_good_within_a_hundredth_of_the_least_held_out_residual():
    for left, chosen in ((1.0099, 0), (1.0101, 2)):
        table = pd.DataFrame(
            {"causal_order": [0, 2], "noncausal_order": 0, "parameters": [1, 3], "heldout": [left, 1.0]}
        )
        assert _choice(table, validated=True).causal_order == chosen


def test_the_usual_orders_grow_by_some_two_fifths_up_to_the_dissertations():
    assert (ORDERS[:4], ORDERS[-1]) == ((0, 1, 2, 3), 50)
    assert all(1.3 < after / before < 1.44 for before, after in itertools.pairwise(ORDERS[4:]))
    assert ORDERS[4] < 1.7 * ORDERS[3]


def test_a_grid_without_end_is_refused_at_once():
    for grid in (itertools.count(), range(10**9)):
        with pytest.raises(InputError, match="causal_orders holds more than 200 orders; give a coarser grid"):
            orders(fir(), causal_orders=grid)
