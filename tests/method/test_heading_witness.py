"""The magnetometer between r and psi: it measures a gyro's error, exonerates it, and is a suspect itself."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.bench.other_sensors import Magnetometer, with_magnetometer
from gtmbench.errors import InputError
from gtmbench.method.magnetometer_witness import HeadingWitness, _explained, _fit, _HeadingFit, _judged
from gtmbench.values.channels import ATTITUDE, GYROS, MAGNETOMETER
from gtmbench.values.record import Record
from tests.helpers.night import by_day

START_S, STOP_S = 90.0, 120.0


@pytest.fixture(scope="module")
def flight():
    truth = gb.fly("gtm", "multisine+turbulence", 125, seed=7)
    readings = gb.measure(truth, noise="t2", seed=7)
    return with_magnetometer(readings, truth, Magnetometer(), seed=7)


@pytest.fixture(scope="module")
def witness(flight):
    return HeadingWitness(healthy=(flight.between(0.0, 85.0),))


def disturbed(flight, per_second):
    """Return a flight whose magnetometer is disturbed more and more since `START_S`, in microtesla."""
    grown = np.maximum(flight.time_s - START_S, 0.0)
    for name, each in zip(MAGNETOMETER, per_second, strict=True):
        flight = flight.replace(name, flight[name] + each * grown)
    return flight


NOBODY = [(gyro, size, claimed, None) for gyro in "pq" for size in (-3.0, 10.0) for claimed in (-3.0, 3.0)]


@pytest.mark.parametrize(
    ("gyro", "size", "claimed", "sensor"),
    [
        *by_day([("r", size, 0.5 * size, "r") for size in (-8.0, 5.0, -5.0, 8.0)], 2),  # a driven heading shows half
        ("r", 0.0, 2.0, "psi"),  # r turns as the field does
        ("r", 1.0, 1.0, None),  # too little to be accused
        ("r", 5.0, -5.0, None),  # what the field contradicts
        ("r", 5.0, 20.0, None),
        *by_day(NOBODY, 2, seed=1),  # of another gyro: never laid on r, nor measured
    ],
)
def test_an_error_of_r_is_measured_and_laid_on_who_shows_it_by_field_and_heading(
    flight, witness, gyro, size, claimed, sensor
):
    broken = gb.inject(flight, gb.Bias(channel=gyro, onset_s=START_S, size=size)) if size else flight
    opinion = witness.judge(broken, START_S, STOP_S, error_deg_s=claimed)
    assert opinion.sensor == sensor
    if gyro == "r":
        assert opinion.error_deg_s == pytest.approx(size, abs=opinion.bound_deg_s)
        assert opinion.bound_deg_s < 1.0


@pytest.mark.parametrize("seed", by_day(range(12)))
def test_a_disturbed_magnetometer_accuses_no_gyro(flight, witness, seed):
    drawn = np.random.default_rng(seed)
    direction = drawn.standard_normal(3)
    record = disturbed(flight, drawn.uniform(0.1, 4.0) * direction / np.linalg.norm(direction))
    for claimed in (-4.0, -1.0, 1.0, 4.0):
        assert witness.judge(record, START_S, STOP_S, error_deg_s=claimed).sensor != "r"


def test_a_strong_disturbance_is_named(flight, witness):
    opinion = witness.judge(disturbed(flight, (0.0, 1.0, 1.0)), START_S, STOP_S, error_deg_s=1.0)
    assert opinion.sensor == "magnetometer"
    assert "strength" in opinion.reason


def turning(bank_deg, seed, size=0.0):
    """Return a turn of 40 s at a bank, with iron that was never calibrated and an error of r."""
    time_s = np.arange(4001) * 0.01
    rate = np.rad2deg(9.80665 * np.tan(np.deg2rad(bank_deg)) / 40.0)
    angles = np.column_stack([np.full(4001, bank_deg), np.zeros(4001), rate * time_s])
    bank = np.deg2rad(bank_deg)
    gyros = np.tile([0.0, rate * np.sin(bank), rate * np.cos(bank) + size], (4001, 1))
    truth = Record(np.hstack([gyros, angles]), channels=[*GYROS, *ATTITUDE], sample_period_s=0.01)
    iron = Magnetometer(hard_iron_ut=(4.0, -3.0, 2.0), soft_iron=0.05)
    return with_magnetometer(truth, truth, iron, seed=seed)


@pytest.mark.parametrize("seed", by_day(range(4)))
@pytest.mark.parametrize("size", by_day([0.0, 4.0, -4.0], 2))
def test_iron_that_shows_only_in_a_turn_is_not_taken_for_a_disturbance(seed, size):
    healthy = tuple(turning(bank, seed) for bank in (0.0, 0.5, 0.0))
    taught = HeadingWitness(healthy=healthy)
    assert taught.judge(turning(35.0, seed, size), 5.0, 25.0, error_deg_s=3.0).sensor is None


def test_the_field_that_true_gyros_carry_back_stays():
    record = turning(30.0, 1)
    opinion = HeadingWitness(healthy=(record, record)).judge(record, 0.0, 20.0, error_deg_s=9.0)
    assert opinion.sensor == "psi"
    assert abs(opinion.error_deg_s) < opinion.bound_deg_s


def test_gaps_and_too_little_say_so(flight, witness):
    missing = flight.replace("r", np.where(np.abs(flight.time_s - 100.0) < 1.0, np.nan, flight["r"]))
    silent = flight.replace("mag_x", np.where(flight.time_s > 95.0, np.nan, flight["mag_x"]))
    for record, stop_s, word in [
        (missing, STOP_S, "gaps"),
        (silent, STOP_S, "gaps"),
        (flight, START_S + 5.0, "too short"),
    ]:
        opinion = witness.judge(record, START_S, stop_s, error_deg_s=3.0)
        assert (opinion.sensor, word in opinion.reason) == (None, True)
    short = HeadingWitness(healthy=(flight.between(0.0, 25.0),))
    assert "healthy stretches" in short.judge(flight, START_S, STOP_S, error_deg_s=3.0).reason


@pytest.mark.parametrize(("rows", "is_known"), [(2750, True), (2749, False)])
def test_eight_healthy_stretches_of_ten_seconds_are_the_fewest(flight, rows, is_known):
    """They begin a quarter of their length apart: the eighth ends after 27.5 s."""
    taught = HeadingWitness(healthy=(flight.part(range(rows)),))
    assert np.isfinite(taught.bound_deg_s(10.0)) == is_known
    assert (taught.judge(flight, START_S, STOP_S, error_deg_s=3.0).sensor is None) or is_known


def test_for_want_of_eight_healthy_stretches_shorter_ones_are_taken_by_a_fifth_each_time(flight):
    """Of a minute there are 3 of 40 s, 4 of 32 s, 6 of 25.6 s, and 8 of 20.5 s."""
    fits, is_as_long = HeadingWitness(healthy=(flight.part(range(6000)),))._usual(40.0)
    assert (len(fits), is_as_long) == (8, False)


@pytest.mark.parametrize(
    ("share", "there", "tells"), [(1.0, 80, True), (1.0, 79, False), (0.1, 20, True), (0.1, 19, False)]
)
def test_four_of_five_usual_readings_have_to_be_there_and_twenty(flight, share, there, tells):
    stretch = flight.part(range(100))
    for name in MAGNETOMETER:
        stretch = stretch.replace(name, np.where(np.arange(100) < there, 20.0, np.nan))
    assert (_fit(stretch, share) is not None) == tells


def test_a_field_may_be_in_any_unit(flight):
    stretch = flight.part(range(3000))
    other = stretch
    for name in MAGNETOMETER:
        other = other.replace(name, 1e3 * stretch[name])
    one, found = (vars(_fit(each, 0.5)) for each in (stretch, other))
    assert 0.0 < one["across"] < 1.0
    for along, across in zip(MAGNETOMETER, (1.0, 1.0, 0.0), strict=True):
        alone = stretch
        for name in MAGNETOMETER:
            alone = alone.replace(name, np.full(len(stretch), 20.0 * (name == along)))
        assert _fit(alone, 1.0).across == across
    for name, value in one.items():
        np.testing.assert_allclose(found[name], value, rtol=1e-9)


def test_a_magnetometer_that_reads_nothing_tells_nothing(flight, witness):
    silent = disturbed(flight, (0.0, 0.0, 0.0))
    for name in MAGNETOMETER:
        silent = silent.replace(name, 0.0 * flight[name])
    assert "gaps" in witness.judge(silent, START_S, STOP_S, error_deg_s=3.0).reason


def fit(yaw=6.0, left=(1.0, 1.0, 0.01), strength=0.0, turn_deg=0.0, across=1.0):
    """Return what a stretch shows: of gyros' errors in deg/s, and how they explain it."""
    return _HeadingFit(
        errors_deg_s=np.array([0.0, 0.0, yaw]),
        left=np.array(left),
        strength=strength,
        turn_deg=turn_deg,
        across=across,
    )


HEALTHY = [  # a middle of 1, a bound of 0.2; of all else the greatest counts
    fit(yaw, (0.01 * size, 0.005, 0.005), 0.05 * size, 20.0 * size)
    for yaw, size in ((0.9, 0.5), (1.0, 1.0), (1.1, 0.8))
]


@pytest.mark.parametrize(
    ("shown", "claimed", "length_s", "sensors"),
    [
        # of each pair of figures the first is within, the second beyond
        ({}, (5.0, -5.0), 20.0, ("r", None)),
        ({"turn_deg": (39.9, 40.1)}, 5.0, 20.0, ("r", None)),  # 1.5 times the largest turn, and 10 deg
        ({"strength": (0.099, 0.101)}, 5.0, 20.0, ("r", "magnetometer")),  # twice the largest
        ({"yaw": 1.0}, (0.41, 0.39), 20.0, ("psi", None)),  # what the heading shows: twice the bound
        ({"left": ((1.0, 1.0, 0.0199), (1.0, 1.0, 0.0201))}, 5.0, 20.0, ("r", None)),  # twice the most that was left
        ({"yaw": (0.801, 0.799)}, 0.41, 20.0, ("psi", None)),  # the bound about the middle
        ({"yaw": 2.0}, (1.49, 1.51), 100.0, ("r", None)),  # 1.3 times the error, and the bound
        ({"yaw": (1.41, 1.39)}, 0.45, 300.0, ("r", None)),  # twice the bound
        ({"left": ((1.0, 0.0142, 0.01), (0.0141, 1.0, 0.01))}, 5.0, 20.0, ("r", None)),  # half of the others' squares
        # a field on a straight way that turns by A is weaker by 1 - cos(A/2) at most: of that arc's RMS about its
        # mean, 2/sqrt(45) of it, 1.5 times what is healthy would have been left
        (
            {"across": tuple(f * 0.03 / (2 / 45**0.5 * (1 - np.cos(np.radians(50)))) for f in (1.01, 0.99))},
            5.0,
            20.0,
            ("r", None),
        ),
        (
            {"across": tuple(f * 0.03 / (2 / 45**0.5) for f in (1.01, 0.99))},
            5.0,
            1000.0,
            ("r", None),
        ),  # 180 deg at most
    ],
    ids=range(11),
)
def test_a_gyro_is_accused_within_all_limits_and_beyond_any_it_is_not(shown, claimed, length_s, sensors):
    for of, sensor in enumerate(sensors):
        said = {name: each[of] if isinstance(each, tuple) else each for name, each in shown.items()}
        claim = claimed[of] if isinstance(claimed, tuple) else claimed
        opinion = _judged(fit(**said), HEALTHY, claim, length_s)
        assert opinion.sensor == sensor
        assert opinion.bound_deg_s == pytest.approx(0.2)
        assert opinion.error_deg_s == pytest.approx(said.get("yaw", 6.0) - 1.0)


def test_an_error_that_grows_evenly_is_found_in_the_middle_and_leaves_nothing():
    time_s = np.array([0.0, 0.5, 1.5, 3.0, 4.0])
    turned = 5.0 + np.outer(0.2 * time_s + 0.05 * (time_s - 2.0) ** 2, [1.0, 0.0, -2.0])
    error, left = _explained(turned, np.tile([1.0, 0.0, -2.0], (5, 1)), time_s)
    assert (error, left) == (pytest.approx(0.2), pytest.approx(0.0, abs=1e-12))
    _, left = _explained(turned + np.outer(time_s >= 3.0, [0.0, 3.0, 0.0]), np.tile([1.0, 0.0, -2.0], (5, 1)), time_s)
    assert left == pytest.approx(np.sqrt(0.5 * (1.2**2 + 1.8**2)))  # two seconds before and two after, about 2/5 of 3


def test_records_that_cannot_be_judged_are_refused(flight, witness):
    with pytest.raises(InputError, match="no healthy record"):
        HeadingWitness(healthy=())
    with pytest.raises(InputError, match="mag_x"):
        HeadingWitness(healthy=(flight.select(GYROS),))
    with pytest.raises(InputError):
        witness.judge(flight.select(GYROS), START_S, STOP_S, error_deg_s=1.0)
    with pytest.raises(InputError):
        witness.judge(gb.decimate(flight, 2), START_S, STOP_S, error_deg_s=1.0)
