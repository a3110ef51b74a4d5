"""A monitor's file: bit for bit what was calibrated, in any process; and whatever else a file holds, one clear line."""

import hashlib
import json
import math
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gtmbench as gb
from gtmbench.detectors import monitor_file as module
from gtmbench.detectors.bank_detector import BankDetector
from gtmbench.detectors.base import FunctionDetector
from gtmbench.detectors.windowed_norm import DissertationOperator
from gtmbench.files.shipped import shipped_banks
from tests.helpers.monitors import monitor, record
from tests.helpers.night import by_day
from tests.helpers.sealed import resealed

ROOT = Path(__file__).parents[2]
BANKS = tuple(shipped_banks())


@pytest.fixture
def saved(tmp_path):
    """Return a saved monitor's path."""
    path = tmp_path / "monitor.json"
    gb.save_monitor(monitor(), path)
    return path


def said(monitor_, of):
    """Return everything that watching gives: digests of arrays, and alarms."""
    looked = monitor_.watch(of)
    arrays = [*looked.residuals.values(), *looked.predictions.values(), *(one.values for one in looked.scores.values())]
    alarms = [(repr(one), repr(one.judgements)) for one in looked.alarms]  # NaN isn't equal to itself, its name is
    return [hashlib.sha256(array.tobytes()).hexdigest() for array in arrays], alarms


@pytest.mark.parametrize("name", ["norm", *by_day(BANKS)])
def test_a_loaded_monitor_judges_bit_for_bit_alike_and_saves_as_the_same_bytes(name, tmp_path):
    mine = norm_monitor() if name == "norm" else monitor(name)
    gb.save_monitor(mine, tmp_path / "m.json")
    loaded = gb.load_monitor(tmp_path / "m.json")
    broken = gb.inject(record(3000, seed=9), gb.Drift(channel="r", onset_s=45.0, slope=5.0))
    assert mine.watch(broken).alarms
    assert said(loaded, broken) == said(mine, broken)
    assert dict(loaded.provenance) == dict(mine.provenance)
    gb.save_monitor(loaded, tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "m.json").read_bytes()


def digest(monitor_):
    arrays, alarms = said(monitor_, record(3000, seed=9))
    return f"{arrays} {alarms}"


@pytest.mark.nightly
def test_another_process_sees_the_same(saved):
    mine = "from tests.detectors.test_monitor_file import digest, gb"
    script = f"import sys; {mine}; print(digest(gb.load_monitor(sys.argv[1])))"
    there = subprocess.run([sys.executable, "-c", script, saved], cwd=ROOT, capture_output=True, text=True, check=True)
    assert there.stdout.strip() == digest(monitor())


def test_an_infinite_threshold_survives_as_the_word_inf(tmp_path):
    long = {"mean 20.48 s", "energy 20.48 s"}  # of which the records hold too few windows
    some = {
        output: {label: math.inf if label in long else value for label, value in of.items()}
        for output, of in monitor().thresholds.items()
    }
    gb.save_monitor(replace(monitor(), thresholds=some), tmp_path / "m.json")
    assert '"inf"' in (tmp_path / "m.json").read_text()
    assert dict(gb.load_monitor(tmp_path / "m.json").thresholds) == some


def test_a_residual_that_never_judges_is_refused(tmp_path):
    never = {output: dict.fromkeys(of, math.inf) for output, of in monitor().thresholds.items()}
    with pytest.raises(
        gb.InputError, match=r"residuals\.p\.thresholds are blind: a step of 20 deviations for 5 s passes"
    ):
        gb.save_monitor(replace(monitor(), thresholds=never), tmp_path / "m.json")


def test_figures_at_the_edge_of_floats_come_back(tmp_path):
    old = monitor().whiteners["p"]
    odd = replace(old, coefficients=np.array([1.0, 5e-324, -0.0, 1e30, 0.1 + 0.2]))
    gb.save_monitor(replace(monitor(), whiteners={**monitor().whiteners, "p": odd}), tmp_path / "m.json")
    assert gb.load_monitor(tmp_path / "m.json").whiteners["p"].coefficients.tobytes() == odd.coefficients.tobytes()


def test_the_old_file_stays_until_the_new_one_is_whole(saved, monkeypatch):
    before, other = saved.read_bytes(), monitor("paper")  # whose flights are written once

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.write_text", full)
    with pytest.raises(gb.GtmbenchError, match=r"monitor\.json: No space left on device; .*; what stood"):
        gb.save_monitor(other, saved)
    assert saved.read_bytes() == before
    assert [path.name for path in saved.parent.iterdir()] == ["monitor.json"]


@pytest.mark.parametrize("provenance", [{"a": math.nan}, {"a": object()}, {"a": np.int64(3)}, {1: 2, "1": 3}])
def test_what_could_not_be_read_back_is_not_saved(provenance, tmp_path):
    with pytest.raises(gb.InputError, match="the monitor can't be saved"):
        gb.save_monitor(replace(monitor(), provenance=provenance), tmp_path / "m.json")
    assert list(tmp_path.iterdir()) == []


def test_places_that_cannot_be_written_are_refused(tmp_path):
    with pytest.raises(gb.InputError, match="is a folder"):
        gb.save_monitor(monitor(), tmp_path)
    with pytest.raises(gb.InputError, match="doesn't exist"):
        gb.save_monitor(monitor(), tmp_path / "nowhere/m.json")


def change(*keys, to):
    """Return a function that puts a value into a document."""

    def apply(document):
        place = document
        for key in keys[:-1]:
            place = place[key]
        place[keys[-1]] = to

    return apply


def drop(*keys):
    def apply(document):
        place = document
        for key in keys[:-1]:
            place = place[key]
        del place[keys[-1]]

    return apply


F = ("figures",)
P = ("figures", "residuals", "p")
BAD = {
    "another format": (change("format", to="recipe"), "isn't a monitor"),
    "a newer version": (change("version", to=4), "version is 4, written by gtmbench '0.1.0'"),
    "version true": (change("version", to=True), "version is True"),
    "no bank": (drop(*F, "bank"), "key 'bank' is missing"),
    "no provenance": (drop("provenance"), "key 'provenance' is missing"),
    "no figures": (drop("figures"), "key 'figures' is missing"),
    "figures of a text": (change("figures", to="C"), "figures is 'C'; it must be a table"),
    "detector of a number": (change("detector", to=3), "detector is 3; it must be a short text"),
    "nobody's detector": (
        change("detector", to="mine"),
        "a monitor of 'mine', which isn't installed here; give --detector FILE.py:OBJECT@FILE.json",
    ),
    "another detector": (change("detector", to="dissertation"), "figures: key 'window' is missing"),
    "an unknown figure": (change("figures", "extra", to=1), "figures: unknown key 'extra'"),
    "an unknown key": (change("extra", to=1), "unknown key 'extra'"),
    "bank of a list": (change(*F, "bank", to=[]), "bank is []"),
    "bank's statistic": (change(*F, "bank", "alarm", "statistic", to=[]), "alarm.statistic is []"),
    "bank without residuals": (change(*F, "bank", "residuals", to=[]), "bank: a bank has 1 to 50"),
    "a residual less": (drop(*F, "residuals", "q"), "residuals: key 'q' is missing"),
    "a residual more": (change(*F, "residuals", "beta", to={}), "residuals: unknown key 'beta'"),
    "period as text": (
        change(*F, "sample_period_s", to="0.01"),
        "sample_period_s is '0.01'; it must be a finite number",
    ),
    "period of nothing": (change(*F, "sample_period_s", to=0), "sample_period_s is 0"),
    "other period": (change(*P, "operator", "sample_period_s", to=0.5), "residuals.p.operator.sample_period_s is 0.5"),
    "inputs": (
        change(*P, "operator", "inputs", to=["q_att"]),
        "residuals.p.operator.inputs is ['q_att']; the bank says",
    ),
    "order": (change(*P, "operator", "causal_order", to=4), "residuals.p.operator.markov holds a list of 11"),
    "absurd order": (
        change(*P, "operator", "causal_order", to=10**9),
        "residuals.p.operator.causal_order is 1000000000",
    ),
    "order of a half": (
        change(*P, "operator", "causal_order", to=4.5),
        "causal_order is 4.5; it must be a whole number",
    ),
    "markov of texts": (change(*P, "operator", "markov", 3, to=[["1.0"]]), "residuals.p.operator.markov is '1.0'"),
    "markov flat": (change(*P, "operator", "markov", to=[1.0] * 11), "where 1 numbers or lists belong"),
    "markov true": (change(*P, "operator", "markov", 3, to=[[True]]), "markov is True"),
    "a mean of null": (change(*P, "operator", "input_means", to=[None]), "input_means is None"),
    "rank": (change(*P, "operator", "rank", to=-1), "residuals.p.operator.rank is -1"),
    "estimator": (change(*P, "operator", "estimator", to=3), "estimator is 3"),
    "no coefficients": (change(*P, "whitener", "coefficients", to=[]), "coefficients is []"),
    "deviation of zero": (
        change(*P, "whitener", "deviation", to=0.0),
        "deviation is 0.0; it must be a finite number, 1e-30 or more",
    ),
    "tolerance": (change(*P, "tolerance", "low", to=1.5), "residuals.p.tolerance.low is 1.5"),
    "threshold as text": (
        change(*P, "thresholds", "mean 0.64 s", to="much"),
        "residuals.p.thresholds, 'mean 0.64 s' is",
    ),
    "a threshold that nothing reaches": (
        change(*P, "thresholds", "energy 0.64 s", to=1e308),
        "residuals.p.thresholds, 'energy 0.64 s' is 1e+308; nothing passes that",
    ),
    "a negative threshold": (
        change(*P, "thresholds", "mean 0.64 s", to=-1.0),
        "residuals.p.thresholds, 'mean 0.64 s' is -1; the test is never below 0",
    ),
    "no threshold": (drop(*P, "thresholds", "mean 0.64 s"), "residuals.p.thresholds: key 'mean 0.64 s' is missing"),
    "a threshold of nothing": (change(*P, "thresholds", "mean 7 s", to=1.0), "unknown key 'mean 7 s'"),
    "the bank's windows": (
        change(*F, "bank", "alarm", "windows_s", to=[1.0]),
        "residuals.p.thresholds: key 'mean 1 s' is",
    ),
    "the bank's baseline": (change(*F, "bank", "alarm", "baseline_s", to=-1.0), "bank: alarm.baseline_s is -1"),
    "norm: window": (change("figures", "window", to=-1), "window is -1"),
    "norm: a threshold that nothing reaches": (
        change("figures", "threshold", to=1e308),
        "threshold is 1e+308; a residual of 10000 all over",
    ),
    "norm: threshold": (
        change("figures", "threshold", to=0),
        "threshold is 0; it must be a finite number greater than 0",
    ),
    "norm: inputs": (change("figures", "operator", "inputs", to=["p"]), "operator.markov holds a list of 3 where 1"),
    "norm: no outputs": (change("figures", "operator", "outputs", to=[]), "operator.outputs is []"),
    "norm: an input twice": (change("figures", "operator", "inputs", to=["p", "p", "q"]), "'p' is given twice"),
    "norm: no operator": (change("figures", "operator", to=None), "operator is None; it must be a table"),
    "norm: a bank's": (change("detector", to="bank"), "figures: key 'bank' is missing"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_wrong_key_is_named_in_one_line(name, saved):
    apply, message = BAD[name]
    if name.startswith("norm"):
        gb.save_monitor(norm_monitor(), saved)
    document = json.loads(saved.read_text())
    apply(document)
    saved.write_text(json.dumps(resealed(document)))
    with pytest.raises(gb.InputError) as refused:
        gb.load_monitor(saved)
    said = str(refused.value)
    assert said.startswith(f"{saved}: ")
    assert message in said
    assert "\n" not in said


TEXTS = {
    "nothing": ("", "isn't whole JSON"),
    "a list": ("[]", "isn't a monitor"),
    "not JSON": ("title = 'C'", "isn't whole JSON"),
    "nested": ("[" * 100_000, "nested too deeply"),
    "NaN": ('{"format": NaN}', "holds NaN"),
    "Infinity": ('{"format": -Infinity}', "holds -Infinity"),
    "too great": ('{"format": 1e999}', "holds 1e999"),
    "a long number": ('{"format": ' + "9" * 5000 + "}", "a whole number of 5000 digits"),
    "a key twice": ('{"format": 1, "format": 2}', "key 'format' stands there twice"),
    "a byte order mark": ("\ufeff{}", "isn't whole JSON"),
}


@pytest.mark.parametrize("name", TEXTS)
def test_what_is_no_monitor_is_refused(name, tmp_path):
    text, message = TEXTS[name]
    (tmp_path / "m.json").write_text(text, encoding="utf-8")
    with pytest.raises(gb.InputError, match=message):
        gb.load_monitor(tmp_path / "m.json")


def test_missing_binary_large_and_truncated_files_are_refused(saved, monkeypatch):
    with pytest.raises(gb.InputError, match="no such file"):
        gb.load_monitor(saved.parent)
    whole = saved.read_bytes()
    for length in range(0, len(whole) - 2, len(whole) // 23):
        saved.write_bytes(whole[:length])
        with pytest.raises(gb.InputError, match="isn't whole JSON"):
            gb.load_monitor(saved)
    saved.write_bytes(bytes(range(256)))
    with pytest.raises(gb.InputError, match="codec"):
        gb.load_monitor(saved)
    saved.write_bytes(whole)
    monkeypatch.setattr(module, "_LARGEST_FILE_BYTES", 100)
    with pytest.raises(gb.InputError, match="at most 100"):
        gb.load_monitor(saved)


def paths(value, at=()):
    """Yield the paths of all places in a document, lists by their first and last entries."""
    yield at
    if isinstance(value, dict):
        for key in value:
            yield from paths(value[key], (*at, key))
    elif isinstance(value, list):
        for i in {0, len(value) - 1} if value else ():
            yield from paths(value[i], (*at, i))


@pytest.fixture(scope="module")
def document(tmp_path_factory):
    path = tmp_path_factory.mktemp("fuzz") / "m.json"
    gb.save_monitor(monitor("B"), path)
    return path, path.read_text()


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=5) | st.just("inf"),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


def loaded_or_refused(path):
    """Return the monitor, or None where it was refused in one line that names the file."""
    try:
        return gb.load_monitor(path)
    except gb.InputError as error:
        said = str(error)
    assert said.startswith(f"{path}: ")
    assert "\n" not in said
    assert len(said) < 600
    return None


@pytest.mark.nightly
@settings(max_examples=150)
@given(data=st.data())
def test_only_input_errors_come_out_of_a_mutated_file(document, data):
    path, text = document
    mutant = json.loads(text)
    for _ in range(data.draw(st.integers(1, 2))):
        at = data.draw(st.sampled_from([place for place in paths(mutant) if place]))
        place = mutant
        for key in at[:-1]:
            place = place[key]
        if data.draw(st.booleans()):
            place[at[-1]] = data.draw(ANYTHING)
        elif isinstance(place, dict):
            del place[at[-1]]
        else:
            place.append(place[at[-1]])
    path.write_text(json.dumps(resealed(mutant)))
    loaded = loaded_or_refused(path)
    if loaded is not None:
        gb.save_monitor(loaded, path)
        first = path.read_bytes()
        gb.save_monitor(gb.load_monitor(path), path)
        assert path.read_bytes() == first


@settings(max_examples=200)
@given(data=st.data())
def test_only_input_errors_come_out_of_flipped_bytes_and_none_is_read_as_another_value(document, data):
    path, text = document
    raw = bytearray(text.encode())
    for _ in range(data.draw(st.integers(1, 4))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(bytes(raw))
    if loaded_or_refused(path) is not None:  # in the layout
        assert module._parsed(raw.decode()) == module._parsed(text)


# --- one envelope for every detector


@cache
def norm_monitor():
    """Return a monitor of the dissertation's operator."""
    recipe = DissertationOperator(causal_order=4, noncausal_order=3, window=50)
    return recipe.calibrate([record(seed=1), record(seed=2)])


@pytest.mark.parametrize("version", [1, 2])
def test_a_file_of_an_older_version_is_read_with_a_note_and_saved_as_version_3(saved, version):
    document = json.loads(saved.read_text())
    del document["digest"]
    if version == 1:
        figures, detector = document.pop("figures"), document.pop("detector")
        assert detector == "bank"
        document |= figures
    saved.with_name("old.json").write_text(json.dumps(document | {"version": version}))
    with pytest.warns(gb.NoteWarning, match=r"old\.json carries no digest, so whether it was altered can't be told"):
        loaded = gb.load_monitor(saved.with_name("old.json"))
    gb.save_monitor(loaded, saved.with_name("new.json"))
    assert saved.with_name("new.json").read_bytes() == saved.read_bytes()


def test_an_altered_figure_is_told_and_another_layout_is_none(saved):
    document = json.loads(saved.read_text())
    saved.write_text(json.dumps(document, indent=7, sort_keys=True))
    gb.load_monitor(saved)
    document["figures"]["residuals"]["p"]["thresholds"]["mean 0.64 s"] *= 1.1
    saved.write_text(json.dumps(document))
    with pytest.raises(gb.InputError, match=r"monitor\.json: what it holds isn't what was written, by its digest"):
        gb.load_monitor(saved)


def test_figures_of_another_recipe_are_refused(saved):
    with pytest.raises(gb.InputError, match="a monitor of 'bank', which 'dissertation' can't restore"):
        gb.load_monitor(saved, DissertationOperator())
    with pytest.raises(gb.InputError, match="the figures are of bank C, whose tables aren't those of bank B"):
        gb.load_monitor(saved, BankDetector(bank=gb.load_bank("B")))
    gb.save_monitor(norm_monitor(), saved)
    with pytest.raises(
        gb.InputError, match=r"with r = 4, d = 3, w = 50; the recipe says .* with r = 50, d = 50, w = 10"
    ):
        gb.load_monitor(saved, DissertationOperator())


def test_nobody_saves_under_a_name_of_gtmbench(tmp_path):
    with pytest.raises(gb.InputError, match="'bank' is the name of a detector of gtmbench; call yours otherwise"):
        gb.save_monitor(FunctionDetector(lambda _: [], name="bank").calibrate(), tmp_path / "m.json")
