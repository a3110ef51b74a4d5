"""Orders, excitations, inputs: what made the data is chosen, and every figure is what a separate one finds."""

import numpy as np
import pandas as pd
import pytest
import scipy.signal

import gtmbench as gb
from gtmbench.errors import InputError
from gtmbench.method.regression import triangle as regression
from gtmbench.report.selection import excitation_figure, order_figure

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
    return record_of(np.pad(both, ((rest, rest), (0, 0))), [*INPUTS, *OUTPUTS])


def record_of(values, channels):
    return gb.Record(values, channels=channels, sample_period_s=0.01)


def orders(record, **changes):
    asked = {"inputs": INPUTS, "outputs": OUTPUTS, "causal_orders": CAUSAL, "noncausal_orders": NONCAUSAL}
    return gb.select_orders(record, **{**asked, **changes})


def separately(record, r, d, largest=(CAUSAL[-1], NONCAUSAL[-1])):
    """Identify one member on the equations of the largest: what lies outside is at rest, so the means stay the same."""
    part = slice(largest[0] - r, len(record) - (largest[1] - d))
    cut = record_of(record.values[part], record.channels)
    return gb.identify(cut, inputs=INPUTS, outputs=OUTPUTS, causal_order=r, noncausal_order=d)


@pytest.fixture
def grams(monkeypatch):
    """Count Gram matrices."""
    calls = []
    gram = regression.gram
    monkeypatch.setattr(regression, "gram", lambda *args: calls.append(args) or gram(*args))
    return calls


# orders


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
    held = orders(records[0], validation=record_of(noisy, records[0].channels), **grid)
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
    one = orders(record, validation=fir(2))
    scaled = [record_of(part.values * scale + 7.0 * scale, part.channels) for part in (record, fir(2))]
    other = orders(scaled[0], validation=scaled[1], inputs=INPUTS[::-1], outputs=OUTPUTS[::-1])
    assert (one.causal_order, one.noncausal_order) == (other.causal_order, other.noncausal_order)
    np.testing.assert_allclose(other.table["rms_y2"], one.table["rms_y2"] * 50.0, rtol=1e-9)
    for name in ("aic", "bic", "heldout"):
        np.testing.assert_allclose(other.table[name], one.table[name], rtol=1e-9)


def test_one_order_is_a_grid_too():
    choice = orders(fir(1), causal_orders=3, noncausal_orders=np.arange(2, 3))
    assert (choice.causal_order, choice.noncausal_order, len(choice.table)) == (3, 2, 1)


def test_a_choice_on_the_edge_of_the_grid_says_so():
    assert "try larger" not in orders(fir(1), causal_orders=range(5), noncausal_orders=range(5)).reason
    cut = orders(fir(1), causal_orders=range(3), noncausal_orders=range(5)).reason
    assert cut.endswith("; the causal order is the largest tried, so try larger ones")


def test_several_records_count_as_one():
    one, two = fir(1, rest=20), fir(2, rest=20)
    gap = orders([one, two])
    joined = orders(record_of(np.vstack([one.values, two.values]), one.channels))
    assert (gap.causal_order, gap.noncausal_order) == (joined.causal_order, joined.noncausal_order)
    assert gap.table["rms_y1"].iloc[-1] == pytest.approx(joined.table["rms_y1"].iloc[-1], rel=0.02)


@pytest.mark.filterwarnings("ignore::gtmbench.errors.RankWarning")
def test_data_that_lack_rank_give_the_figures_of_the_shortest_solutions():
    """u2 is u1, doubled: every member lacks rank."""
    one, other = (
        record_of(part.values[:, [0, 0, 2, 3]] * [1, 2, 1, 1], part.channels) for part in (fir(1, rest=11), fir(2))
    )
    table = orders(one, validation=other).table
    assert np.isfinite(table.to_numpy()).all()
    np.testing.assert_array_equal(table["rank"] * 2, table["parameters"])
    for row in table.itertuples():
        operator = separately(one, row.causal_order, row.noncausal_order)
        assert row.rms_y1 == pytest.approx(operator.rms_residual[0], rel=1e-9)
        left = gb.residual(operator, other).values[CAUSAL[-1] : len(other) - NONCAUSAL[-1]]
        assert row.heldout_y1 == pytest.approx(np.sqrt(np.mean(left[:, 0] ** 2)), rel=1e-6)


def test_noise_free_sinusoids_need_no_more_than_what_fits_them():
    angle = 2.0 * np.pi * np.arange(2000) / 50
    values = np.column_stack([np.sin(angle), 2.0 * np.sin(angle + 0.7)])
    record = record_of(values, ["u", "y"])
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
        ({"causal_orders": [400]}, "600 samples of u1, u2 give 195 equations for 812 Markov parameters of 'y1'"),
        ({"inputs": ["u1", "alpha"]}, "no channel 'alpha'"),
        ({"inputs": ["u1", "y1"]}, "'y1' is both pseudo input and pseudo output"),
        ({"outputs": []}, "at least one pseudo input and one pseudo output"),
        ({"validation": fir(1).select(INPUTS)}, "no channel 'y1', 'y2' in this record"),
        ({"validation": []}, "no record given"),
        ({"validation": record_of(fir(1).values[:10], [*INPUTS, *OUTPUTS])}, "10 samples for validation give no equ"),
        (
            {"validation": gb.Record(np.ones((50, 4)), channels=[*INPUTS, *OUTPUTS], sample_period_s=1)},
            "those to identify on every 0.01 s; resample",
        ),
        ({"validation": record_of(np.full((50, 4), np.nan), [*INPUTS, *OUTPUTS])}, "'u1' has 50 missing samples"),
    ],
    ids=str,
)
def test_what_no_orders_can_be_chosen_from_is_refused(asked, message):
    with pytest.raises(InputError, match=message) as refused:
        orders(fir(1), **asked)
    assert "\n" not in str(refused.value)


# excitations


def zeros_and_poles(rng, count):
    """Return a polynomial with `count` (even) roots inside the unit circle."""
    radius, angle = rng.uniform(0.3, 0.85, count // 2), rng.uniform(0.0, np.pi, count // 2)
    return radius * np.exp(1j * angle)


def driven(seed, excitations, snr, *, sensors=5, samples=4000):
    """Return sensors that broadband excitations drive: one set of stable poles, zeros on both sides of the circle."""
    rng = np.random.default_rng([seed, excitations, snr])
    u = rng.standard_normal((samples + 200, excitations))
    poles = zeros_and_poles(rng, 2)
    values = np.zeros((samples + 200, sensors))
    for sensor in range(sensors):
        for source in range(excitations):
            zeros = zeros_and_poles(rng, 2)
            zeros = np.where(rng.random(1) < 0.5, zeros, 1.0 / zeros)
            one = scipy.signal.lfilter(*(np.poly([*z, *z.conj()]).real for z in (zeros, poles)), u[:, source])
            values[:, sensor] += one / one.std() * rng.uniform(0.5, 2.0)
    values = values[200:]
    values += rng.standard_normal(values.shape) * values.std(axis=0) / snr
    return record_of(values, [f"s{i}" for i in range(sensors)])


def counted(record, channels=None, **changes):
    asked = {"causal_order": 20, "noncausal_order": 20, **changes}
    return gb.count_excitations(record, channels=record.channels if channels is None else channels, **asked)


@pytest.mark.parametrize("snr", [30, 100, 1000])
@pytest.mark.parametrize("excitations", [1, 2, 3])
def test_as_many_excitations_are_counted_as_there_are(excitations, snr):
    """Zeros next to the unit circle can take more lags than there are: one of ten may be missed."""
    found = [counted(driven(seed, excitations, snr)) for seed in range(10)]
    hits = [one.excitations == excitations for one in found]
    assert sum(hits) >= 9, [one.reason for one in found]
    assert all(one.reason.startswith(f"{excitations}: ") for one, hit in zip(found, hits, strict=True) if hit)


def test_every_choice_is_what_a_separate_identification_finds():
    record = driven(3, 2, 30, samples=1000)
    table = counted(record, causal_order=3, noncausal_order=4).table
    assert len(table) == 5 * 4 + 10 * 3 + 10 * 2 + 5 * 1
    for row in table.sample(20, random_state=1).itertuples():
        asked = {"causal_order": 3, "noncausal_order": 4}
        operator = gb.identify(record, inputs=row.inputs, outputs=[row.output], **asked)
        expected = np.sqrt(operator.noise_variance[0]) / record[row.output].std()
        assert row.relative_residual == pytest.approx(expected, rel=1e-9)


def test_the_choices_are_one_gram_matrix(grams):
    counted(driven(3, 2, 30), causal_order=3, noncausal_order=4)
    assert len(grams) == 1


def test_neither_units_nor_the_order_of_channels_change_the_count():
    record = driven(3, 2, 30, samples=1500)
    one = counted(record)
    scaled = record_of(record.values * np.array([1e-6, 1.0, 1e3, 1e6, 50.0]) + 3.0, record.channels)
    other = counted(scaled, record.channels[::-1])
    assert one.excitations == other.excitations == 2
    np.testing.assert_allclose(one.by_m, other.by_m, rtol=1e-8)


def test_as_many_excitations_as_sensors_are_not_bounded():
    found = counted(driven(1, 3, 100, sensors=4), ["s0", "s1", "s2"])
    assert found.excitations is None
    alone = counted(driven(1, 3, 100, sensors=4))
    assert alone.excitations is None
    assert alone.reason.startswith("at least 3: ")


def test_noise_is_predicted_by_nothing():
    noise = record_of(np.random.default_rng(1).standard_normal((400, 4)), ["a", "b", "c", "d"])
    found = counted(noise, causal_order=10, noncausal_order=10)
    assert found.excitations is None
    assert found.reason.startswith("no choice of inputs predicts the others")
    np.testing.assert_allclose(found.by_m, 1.0, atol=0.1)  # short records feign no drop


def test_a_sinusoid_is_one_excitation_however_many_drive():
    """One frequency: two lags of any sensor hold all there is, as the docstring says."""
    angle = 2.0 * np.pi * np.arange(3000) / 50
    rng = np.random.default_rng(1)
    waves = [np.sin(angle + phase) for phase in rng.uniform(0, 6, 4)]
    record = record_of(np.column_stack(waves) + 0.01 * rng.standard_normal((3000, 4)), ["a", "b", "c", "d"])
    assert counted(record).excitations == 1


def test_sensors_without_noise_are_counted_too():
    rng = np.random.default_rng(1)
    record = record_of(rng.standard_normal((800, 2)) @ rng.standard_normal((2, 5)), ["a", "b", "c", "d", "e"])
    assert counted(record, causal_order=2, noncausal_order=2).excitations == 2


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"channels": ["s0"]}, "channels names 1; it takes 2 to predict one another"),
        ({"channels": ["s0", "s0"]}, "'s0' is given twice"),
        ({"channels": ["s0", "alpha"]}, "no channel 'alpha'"),
        ({"channels": [f"s{i}" for i in range(11)]}, "11 channels are 2046 choices of inputs; give at most 10"),
        ({"gain": 1.0}, "gain is 1.0; it must be a finite number greater than 1"),
        ({"causal_order": 90}, "give 190 equations for 555 Markov parameters; record at least 665 samples"),
        ({"noncausal_order": -1}, "noncausal_order is -1"),
    ],
    ids=str,
)
def test_what_excitations_cant_be_counted_from_is_refused(asked, message):
    record = driven(3, 2, 30, samples=300)
    with pytest.raises(InputError, match=message) as refused:
        counted(record, **asked)
    assert "\n" not in str(refused.value)


# inputs


def decoyed(seed, samples=1500):
    """Return four candidates, of which "a" and "c" (the stronger) make y and z."""
    rng = np.random.default_rng([5, seed])
    values = rng.standard_normal((samples, 6))
    values[:, 3] += 0.5 * values[:, 0]  # a decoy that looks like "a"
    a, c = values[:, 0], values[:, 2]
    values[:, 4] = np.roll(a, 1) - 2.0 * c + 0.5 * np.roll(c, -2) + 0.1 * values[:, 4]
    values[:, 5] = 3.0 * np.roll(c, 2) + a + 0.1 * values[:, 5]
    return record_of(values, ["a", "b", "c", "d", "y", "z"])


def chosen(record, **changes):
    asked = {"candidates": ["a", "b", "c", "d"], "outputs": ["y", "z"], "causal_order": 3, "noncausal_order": 3}
    return gb.select_inputs(record, **{**asked, **changes})


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("outputs", [["y"], ["z"], ["y", "z"]])
def test_the_inputs_that_made_the_data_are_chosen_among_decoys(seed, outputs):
    found = chosen(decoyed(seed), outputs=outputs)
    assert found.inputs == ("c", "a")
    assert found.reason.startswith("c, a: the least BIC of the steps 0..4 is that of step 2")


def test_every_step_is_what_a_separate_identification_finds(grams):
    record = decoyed(1)
    table = chosen(record).table
    assert len(grams) == 1
    assert table["step"].tolist() == [1, 2, 3, 4]
    before = record.matrix(["y", "z"]).std(axis=0)
    for step in range(1, 5):
        inputs = table["input"][:step].tolist()
        operator = gb.identify(record, inputs=inputs, outputs=["y", "z"], causal_order=3, noncausal_order=3)
        np.testing.assert_allclose(table.loc[step - 1, ["rms_y", "rms_z"]], operator.rms_residual, rtol=1e-9)
        fall = np.exp(np.log(before / operator.rms_residual).mean())
        assert table["gain"][step - 1] == pytest.approx(fall, rel=1e-2 if step == 1 else 1e-9)
        before = operator.rms_residual


def test_units_and_order_of_the_candidates_dont_change_the_inputs():
    record = decoyed(1)
    scaled = record_of(record.values * np.array([1e-6, 1e6, 1e3, 1.0, 1e-3, 1e6]), record.channels)
    other = chosen(scaled, candidates=["d", "c", "b", "a"])
    assert other.inputs == ("c", "a")
    np.testing.assert_allclose(other.table["bic"], chosen(record).table["bic"], rtol=1e-9)


def test_no_more_inputs_than_allowed_are_chosen():
    found = chosen(decoyed(1), most=1)
    assert found.inputs == ("c",)
    assert len(found.table) == 1
    assert "the most that were allowed" in found.reason


def test_where_no_candidate_helps_none_is_chosen():
    found = chosen(decoyed(1), candidates=["b"], outputs=["y"])
    assert found.inputs == ()
    assert found.reason == "no candidate lowers the BIC: none of b predicts y"


def test_a_copy_of_an_input_adds_nothing():
    record = decoyed(1)
    copied = record.replace("b", 2.0 * record["c"])
    found = chosen(copied)
    assert set(found.inputs) in ({"a", "b"}, {"a", "c"})
    assert found.table["gain"].iloc[-1] == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"candidates": []}, "at least one pseudo input and one pseudo output"),
        ({"candidates": ["a", "y"]}, "'y' is both pseudo input and pseudo output"),
        ({"most": 0}, "most is 0; it must be a whole number, 1 or more"),
        ({"causal_order": 900}, "give 597 equations for 3616 Markov parameters of 'y'"),
    ],
    ids=str,
)
def test_what_inputs_cant_be_chosen_from_is_refused(asked, message):
    with pytest.raises(InputError, match=message) as refused:
        chosen(decoyed(1), **asked)
    assert "\n" not in str(refused.value)


# figures


@pytest.mark.parametrize("name", [None, "bic", "rms_y1"])
def test_the_figure_of_a_surface_marks_the_recommendation(name, tmp_path):
    choice = orders(fir(1), validation=fir(2))
    figure = order_figure(choice, name=name)
    figure.savefig(tmp_path / "orders.png")
    (mark,) = figure.axes[0].lines
    at = CAUSAL.index(choice.causal_order), NONCAUSAL.index(choice.noncausal_order)
    assert (mark.get_ydata()[0], mark.get_xdata()[0]) == at


def test_the_figure_of_a_count_shows_every_choice(tmp_path):
    found = counted(driven(1, 2, 100))
    figure = excitation_figure(found)
    figure.savefig(tmp_path / "excitations.png")
    dots, curve, mark = figure.axes[0].lines
    assert len(dots.get_xdata()) == len(found.table)
    pd.testing.assert_series_equal(pd.Series(curve.get_ydata()[1:]), found.by_m, check_names=False, check_index=False)
    assert mark.get_xdata()[0] == 2
