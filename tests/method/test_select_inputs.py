"""Choosing inputs: those that made the data are chosen, and every step is a separate identification."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.errors import InputError
from tests.helpers.oracles import sampled


def decoyed(seed, samples=1500):
    """Return four candidates, of which "a" and "c" (the stronger) make y and z."""
    rng = np.random.default_rng([5, seed])
    values = rng.standard_normal((samples, 6))
    values[:, 3] += 0.5 * values[:, 0]  # a decoy that looks like "a"
    a, c = values[:, 0], values[:, 2]
    values[:, 4] = np.roll(a, 1) - 2.0 * c + 0.5 * np.roll(c, -2) + 0.1 * values[:, 4]
    values[:, 5] = 3.0 * np.roll(c, 2) + a + 0.1 * values[:, 5]
    return sampled(values, ["a", "b", "c", "d", "y", "z"])


def chosen(record, **changes):
    asked = {"candidates": ["a", "b", "c", "d"], "outputs": ["y", "z"], "causal_order": 3, "noncausal_order": 3}
    return gb.select_inputs(record, **{**asked, **changes})


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("outputs", [["y"], ["z"], ["y", "z"]])
def test_the_inputs_that_made_the_data_are_chosen_among_decoys(seed, outputs):
    choice = chosen(decoyed(seed), outputs=outputs)
    assert choice.inputs == ("c", "a")
    assert choice.reason.startswith("c, a: the least BIC of the steps 0..4 is that of step 2")


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
    scaled = sampled(record.values * np.array([1e-6, 1e6, 1e3, 1.0, 1e-3, 1e6]), record.channels)
    other = chosen(scaled, candidates=["d", "c", "b", "a"])
    assert other.inputs == ("c", "a")
    np.testing.assert_allclose(other.table["bic"], chosen(record).table["bic"], rtol=1e-9)


def test_no_more_inputs_than_allowed_are_chosen():
    choice = chosen(decoyed(1), most=1)
    assert choice.inputs == ("c",)
    assert len(choice.table) == 1
    assert "the most that were allowed" in choice.reason


def test_where_no_candidate_helps_none_is_chosen():
    choice = chosen(decoyed(1), candidates=["b"], outputs=["y"])
    assert choice.inputs == ()
    assert choice.reason == "no candidate lowers the BIC: none of b predicts y"


def test_what_follows_exactly_leaves_next_to_nothing():
    record = decoyed(1)
    choice = chosen(record.replace("y", np.roll(record["c"], 1)), outputs=["y"])
    assert choice.inputs == ("c",)
    assert choice.table["rms_y"].iloc[0] < 1e-10


def test_a_copy_of_an_input_adds_nothing():
    record = decoyed(1)
    copied = record.replace("b", 2.0 * record["c"])
    choice = chosen(copied)
    assert set(choice.inputs) in ({"a", "b"}, {"a", "c"})
    assert choice.table["gain"].iloc[-1] == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"candidates": []}, "at least one pseudo input and one pseudo output"),
        ({"candidates": ["a", "y"]}, "'y' is both pseudo input and pseudo output"),
        ({"most": 0}, "most is 0; it must be a whole number, 1 or more"),
        ({"causal_order": 900}, "give 597 equations for 3616 Markov parameters and a constant of 'y'"),
    ],
    ids=str,
)
def test_what_inputs_cant_be_chosen_from_is_refused(asked, message):
    with pytest.raises(InputError, match=message) as refused:
        chosen(decoyed(1), **asked)
    assert "\n" not in str(refused.value)
