"""How kinds show: what a class says of itself holds, or it is refused in a line."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.faults import registry
from gtmbench.faults.fault import inject
from gtmbench.faults.registry import FAULTS, check_shape, grows, shape_of, tried, whole_log_of
from gtmbench.faults.shape import CONSTANT, HELD, SHOWN, is_always, is_beyond, is_constant, is_last, is_one_sided

LINEAR = [cls for cls in FAULTS.values() if cls.shape is not None and cls.shape.how in ("linear", "gain")]
STILL = gb.Record(np.zeros((1, 1)), channels=["p"], sample_period_s=0.01)
SIGNAL = 4.0 * np.sin(np.arange(300) / 9.0)


@pytest.fixture(autouse=True)
def nothing_registered(monkeypatch):
    monkeypatch.setattr(registry, "_registered", {})


def own(effect, **said):
    """Return a class of a user's whose reading is effect(y, size, t)."""

    @dataclass(frozen=True, kw_only=True)
    class Own(gb.Fault):
        kind = "own"
        shape = gb.Shape(**{"how": "linear", "parameter": "size"} | said)
        size: float = gb.severity()

        def distort(self, readings, elapsed_s, sample_period_s, carried):
            return effect(readings[:, 0], self.size, elapsed_s), carried

    return Own


@pytest.mark.parametrize("cls", [cls for cls in LINEAR if not cls.shape.beside], ids=lambda cls: cls.kind)
def test_a_linear_kind_adds_its_size_times_what_it_adds_at_size_one(cls):
    healthy, name = cls.shape.healthy, cls.shape.parameter
    one, many = tried(cls, {name: healthy + 1.0}), tried(cls, {name: healthy - 3.5})
    np.testing.assert_allclose(many, -3.5 * one, rtol=1e-12, atol=1e-12)
    assert not tried(cls, {name: healthy}).any()


def test_the_figure_of_a_kind_is_what_makes_it_larger():
    figures = {kind: cls.shape.figure for kind, cls in FAULTS.items() if cls.shape is not None and cls.shape.figure}
    assert all(name in {each.name for each in FAULTS[kind].parameters()} for kind, name in figures.items())
    assert (figures["thermal_bias"], figures["lag"], figures["bias"]) == ("size", "lag_s", "size")


def test_what_is_tried_later_has_been_there_for_longer():
    later_s, since_s = 3.0, 0.01 * np.arange(200)
    np.testing.assert_allclose(tried(FAULTS["drift"], {"slope": 2.0}, later_s), 2.0 * (since_s + later_s), atol=1e-12)


def test_a_kind_of_large_errors_that_are_rounded_is_still_linear():
    gb.register_fault(own(lambda y, size, *_: (1.0 + 1e5 * size) * (y + 1.0) - 1e5 * size - 1.0))
    assert shape_of("own").how == "linear"


def test_a_kind_is_linear_that_is_so_to_a_millionth_of_the_most_that_it_adds_and_may_add_nothing_to_some():
    check_shape(own(lambda y, size, *_: y + size * np.maximum(y, 0.0) * (1.0 + 0.9e-6 * size)))
    with pytest.raises(gb.InputError, match="isn't linear in size"):
        check_shape(own(lambda y, size, *_: y + size * np.maximum(y, 0.0) * (1.0 + 1.1e-6 * size)))


SEARCHED = {  # between which values: what diagnoses were measured with
    "thermal_bias": (0.5, 20.0),  # s
    "delay": (0.01, 1.0),  # s
    "lag": (0.005, 1.0),  # s
    "clock_slip": (0.0005, 0.2),
    "deadzone": (0.01, 1.0),  # of the reach
    "saturation": (0.01, 1.0),
    "hysteresis": (0.02, 2.0),  # both ways
    "rate_saturation": (0.01, 1.0),  # of the slew
}
# than noise alone lets expect
LESS_SURE = {
    "drift": 1.7,
    "thermal_bias": 1.7,
    "scale_drift": 1.7,
    "random_walk": 2.0,
    "hysteresis": 1.5,
    "clock_slip": 8.0,
}
WHOLE_LOG = {  # what verdicts on whole logs were measured with
    "bias": {"least": 0.4},
    "drift": {"least": 0.01, "price": 1.0, "shortest_s": 15.0},
    "scale_factor": {"least": 0.12, "shortest_s": 7.0, "low": -4.0, "high": 3.0, "is_gain": True, "mirror": 1.0},
    "deadzone": {"least": 0.2, "price": 3.0, "shortest_s": 15.0, "low": 0.0, "high": 2.0}
    | {"is_gain": True, "of_motion": True},
}
CERTIFIED_S = {"bias": 10.0, "drift": 20.0, "noise": 10.0, "scale_factor": 10.0, "deadzone": 10.0}


def test_kinds_are_looked_for_with_what_diagnoses_verdicts_and_certificates_were_measured_with():
    usual = {"price": 0.0, "low": -np.inf, "high": np.inf, "shortest_s": 0.0, "is_gain": False, "of_motion": False}
    for kind, cls in FAULTS.items():
        shape, whole = shape_of(kind), whole_log_of(kind)
        if shape is not None:
            assert (shape.low, shape.high) == SEARCHED.get(kind, (0.0, 0.0))
            assert (shape.spread, shape.price) == (LESS_SURE.get(kind, 1.0), 0.0)
            assert shape.healthy == float(kind == "scale_factor")
        assert cls.typical.certified_s == CERTIFIED_S.get(kind)
        assert (whole is not None) == (kind in WHOLE_LOG)
        for name, value in (usual | WHOLE_LOG.get(kind, {})).items() if whole else ():
            assert getattr(whole, name) == value


def test_the_sizes_that_a_class_calls_mild_and_strong_are_those_that_its_report_has_tried():
    """A name and a figure, as 'mild, 0.3 deg/s': in the channel's unit, in percents of something, or alone."""
    rows = json.loads(Path("experiments/reports/every_fault_again/results.json").read_text())["tables"][1]
    tried = {(row["fault"], row["sensors"]): set() for row in rows}
    for row in rows:
        _, _, figure = row["severity"].partition(", ")
        tried[row["fault"], row["sensors"]] |= {figure.split()[0]} if figure else set()
    for (kind, sensors), figures in tried.items():
        typical, shape = FAULTS[kind].typical, shape_of(kind)
        of_class = typical.gyro if sensors == "gyro" else typical.angle
        assert {f"{each:g}" for each in of_class} - ({"0"} if not figures else set()) == figures
        if kind == "bias" and shape is not None:
            assert inject(STILL, gb.Bias(channel="p", onset_s=0.0, size=of_class[-1]))["p"].tolist() == [of_class[-1]]


def test_what_a_gyro_reads_too_much_in_a_whole_log_is_linear_in_the_size_of_a_kind():
    read, time_s = np.array([-2.0, -0.151, 0.149, 0.151]), np.arange(4.0)
    wrong = {kind: whole_log_of(kind).wrong(read, time_s).tolist() for kind in WHOLE_LOG}
    assert wrong == {
        "bias": [1.0] * 4,
        "drift": time_s.tolist(),
        "scale_factor": read.tolist(),
        "deadzone": [1.0, 1.0, 0.0, -1.0],
    }
    factor = whole_log_of("scale_factor").parameter  # of a gyro that reads f times its rate (f - 1) / f are wrong
    assert [factor(size) for size in (0.5, -1.0, 2.0)] == pytest.approx([2.0, 0.5, -1.0])
    assert (factor(1.0 + 0.9e-6), factor(1.0 + 1.1e-6) < 0.0) == (np.inf, True)


def test_what_stays_at_one_reading_is_constant_and_what_repeats_itself_held():
    assert CONSTANT == ("last", "constant", "beyond")
    assert ((*CONSTANT, "repeated"), (*CONSTANT, "repeated", "rounded")) == (HELD, SHOWN)


def test_what_grows_is_what_does_more_a_second_later():
    assert {cls.kind for cls in FAULTS.values() if grows(cls)} == {"drift", "thermal_bias", "scale_drift", "clock_slip"}


@pytest.mark.parametrize(
    "fault", [gb.Deadzone(channel="p", onset_s=0.0, half_width=1.5), gb.Saturation(channel="p", onset_s=0.0, limit=2.0)]
)
def test_what_should_have_been_read_reads_the_same_once_more(fault):
    def read(signal):
        return fault.distort(signal[:, np.newaxis], np.arange(300) / 100.0, 0.01, None)[0]

    broken = read(SIGNAL)
    for expected in (SIGNAL, np.zeros(300), 9.0 * SIGNAL):  # what the readings don't tell is taken from it
        should = fault.undone(broken, expected)
        np.testing.assert_allclose(read(should), broken, atol=1e-12)
        if expected is SIGNAL:
            np.testing.assert_allclose(should, SIGNAL, atol=1e-12)


def test_what_reads_as_another_kind_would_is_told_by_the_readings_at_their_limits():
    before, last = np.tile([-1.0, 1.0], 50), 1.0
    within = 3.0 * np.sqrt(2.0)  # three deviations of a noise whose steps have one of 2
    for sign in (-1.0, 1.0):
        assert is_last(before, np.array([9.0, last + sign * 0.999 * within]))
        assert not is_last(before, np.array([last, last + sign * 1.001 * within]))
        assert is_beyond(before, np.array([sign * 1.001]))
        assert not is_beyond(before, np.array([sign * 2.0, sign * 1.0]))
        assert is_one_sided(before, sign * np.array([0.1, 2.0]))
        assert not is_one_sided(before, sign * np.array([0.1, 0.0]))
    assert is_last(before[:2], before[1:2])
    assert not is_last(before[:1], before[:1])
    assert not is_beyond(before[:0], before)
    assert is_beyond(before[:1], 2.0 * before)
    assert is_always(before, before)
    assert is_constant(before, np.ones(3))
    assert not is_constant(before, before)


@pytest.mark.parametrize(
    ("cls", "said"),
    [
        (own(lambda y, *_: y * np.nan), r"own: with size = 1 it reads no number"),
        (own(lambda y, *_: np.where(y > 6.0, np.nan, y)), r"own: with size = 1 it reads no number"),
        (own(lambda y, *_: y[:-1]), r"own: with size = 1 it reads no number"),
        (own(lambda y, size, at: y + size + size**2 * (at > 1.985)), r"own isn't linear in size"),
        (own(lambda y, size, at: y + size + (at > 1.985)), r"own: with size = 0 it changes something"),
        (own(lambda y, size, *_: y + size**2), r"own isn't linear in size; give it a shape that is a search"),
        (own(lambda y, *_: y), r"own isn't linear in size"),
        (own(lambda y, size, *_: size * y), r"own: with size = 0 it changes something; say what is healthy"),
        (
            own(lambda y, size, *_: y + size, parameter="gain"),
            r"own: its shape's parameter is 'gain'; it has \['size'\]",
        ),
        (own(lambda y, size, *_: y + size, how="white"), r"its shape's how is 'white'; it must be 'linear', 'search'"),
        (own(lambda y, size, *_: y + size, how="fixed", parameter=""), r"own: its shape leaves size open"),
        (own(lambda y, *_: y / 0.0, how="search", low=1.0, high=4.0), r"own: with size = 2 it reads no number"),
    ],
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_shape_that_isnt_what_it_says_is_refused(cls, said):
    with pytest.raises(gb.InputError, match=said):
        gb.register_fault(cls)
    assert "own" not in registry.fault_kinds()


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ({"how": "linar"}, "how is 'linar'; it must be linear, search"),
        ({"how": "linear", "price": float("nan")}, "price is nan"),
        ({"how": "linear", "price": -3.0}, "price is -3.0"),
        ({"how": "search", "parameter": "size", "low": 4.0, "high": 1.0}, "high is 1.0"),
        ({"how": "search", "parameter": "size", "low": 1.0, "high": 1.0}, "high is 1.0"),
        ({"how": "search", "parameter": "size", "low": 0.0, "high": 1.0}, "low is 0.0"),
        ({"how": "search", "low": 1.0, "high": 2.0, "when": "never"}, "when is 'never'"),
    ],
)
def test_a_shape_with_a_bad_figure_is_refused(said, message):
    with pytest.raises(gb.InputError, match=message):
        gb.Shape(**said)


def test_a_class_that_reads_another_channel_or_leaves_a_parameter_open_needs_a_default():
    @dataclass(frozen=True, kw_only=True)
    class Leak(gb.Fault):
        kind = "leak"
        shape = gb.Shape(how="linear", parameter="share")
        share: float = gb.severity(unit="")
        source: str = gb.other_channel()

        def distort(self, readings, elapsed_s, sample_period_s, carried):
            return readings[:, 0] + self.share * readings[:, 1], carried

    with pytest.raises(gb.InputError, match="leak: its shape leaves source open"):
        check_shape(Leak)
