"""A course piece by piece: rates and means, what a GPS's delay is, what stands, jumps or is misread, and doubts."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gtmbench.engine.course import cleared, judged, misread
from gtmbench.engine.course.blocked import blocked
from gtmbench.engine.course.course import Course, course_of
from gtmbench.engine.course.jumps import _is_calm, gps_jumps, jumps
from gtmbench.engine.course.relations import roughness
from gtmbench.engine.course.relations.registry import relations_of
from gtmbench.engine.course.standing import Stands, standing
from gtmbench.engine.explanation import Explanation
from gtmbench.engine.finding import FROZEN, Finding
from gtmbench.engine.relation import Effect
from gtmbench.engine.samples import Samples
from gtmbench.values.channels import ACCELEROMETERS, GPS_VELOCITY, MAGNETOMETER
from tests.engine.course.coursing import FIELD, FOOT_M, G_M_S2, KNOT_M_S, WIND_M_S, coursed, flight_from, samples_of

DURATION_S = 100.0


@pytest.fixture(scope="module")
def flight():
    return flight_from(coursed())


@pytest.fixture(scope="module")
def exact():
    """A course whose readings are those of its motion."""
    record = coursed(noise=0.0)
    return course_of(flight_from(record), samples_of(record))


def course_from(record, *left_out):
    return course_of(flight_from(record), samples_of(record, *left_out))


# what is read -----------------------------------------------------------------------------------------------------


def test_a_course_is_in_m_m_s_and_m_s2_forward_right_and_down(exact):
    record, at_s = coursed(noise=0.0), exact.flight.blocks.time_s + 0.1
    units = {"nx": G_M_S2, "ny": G_M_S2, "nz": -G_M_S2, "tas": KNOT_M_S, "altitude": FOOT_M, "alpha": 1.0, "mag_x": 1.0}
    for name, unit in units.items():
        expected = unit * np.interp(at_s, record.time_s, record[name])
        np.testing.assert_allclose(exact.read[name][1:-1], expected[1:-1], atol=0.01 * np.ptp(expected))
        assert exact.unit_of(name) == (pytest.approx(1.0 / unit) if name != "mag_x" else exact.strength)
    assert exact.strength == pytest.approx(np.linalg.norm(FIELD), rel=1e-3)
    assert exact.has("wind_north", "tas")
    windier = exact.off_by(Effect(channels={"wind_north": np.ones(len(exact.flight))}), 2.0)
    assert (windier.through - exact.through)[9].tolist() == pytest.approx([2.0, 0.0, 0.0])
    told = judged._in_units(exact, finding("nz", size=2.0, interval=(1.0, 3.0)))
    assert (told.size, *told.interval) == pytest.approx((-2.0 / G_M_S2, -3.0 / G_M_S2, -1.0 / G_M_S2))
    assert judged._in_units(exact, finding("nz", "noise", size=2.0)).size == 2.0
    assert not exact.has("tas", "rpm")
    for count in (1, 2):
        few = {"tas": Samples(record.time_s, np.where(np.arange(len(record)) < count, record["tas"], np.nan))}
        assert course_of(exact.flight, few).has("tas") == (count == 2)
    for period_s, second in ((0.2, 5), (0.3, 3), (1.0, 1), (3.0, 1)):
        slow = SimpleNamespace(blocks=SimpleNamespace(period_s=period_s))
        assert Course(flight=slow, matrices=None, read={}).second == second


def test_the_axes_of_the_air_lie_along_the_way_and_across_it_whatever_the_vanes_read(exact):
    """The way is at alpha below the nose and at beta to its right; the normal lies in the aircraft's own plane."""
    alpha, beta = np.random.default_rng(1).uniform(-60.0, 60.0, (2, len(exact.flight)))
    axes = replace(exact, read=exact.read | {"alpha": alpha, "beta": beta}).air_axes @ exact.matrices  # in body axes
    np.testing.assert_allclose(axes @ axes.transpose(0, 2, 1), np.tile(np.eye(3), (len(axes), 1, 1)), atol=1e-12)
    np.testing.assert_allclose(axes[:, 0, 2] / axes[:, 0, 0], np.tan(np.radians(alpha)))
    np.testing.assert_allclose(axes[:, 0, 1], np.sin(np.radians(beta)))
    np.testing.assert_allclose(axes[:, 2, 1], 0.0, atol=1e-12)
    assert (axes[:, [0, 1, 2], [0, 1, 2]] > 0.0).all()


def test_rates_are_of_a_second_that_ends_with_a_block_and_means_of_the_same(flight):
    course, time_s = Course(flight=flight, matrices=None, read={}), flight.blocks.time_s
    ramp, square = (3.0 * time_s)[:, np.newaxis], (time_s**2)[:, np.newaxis]
    assert course.rates(ramp)[5:] == pytest.approx(3.0)
    np.testing.assert_allclose(course.over_second(2.0 * ramp)[5:, 0], course.rates(3.0 * square)[5:, 0])
    assert np.isnan([course.rates(ramp)[:5], course.over_second(ramp)[:5]]).all()
    for missing in (0, 40, len(time_s) - 1):
        ramp[missing] = np.nan
        unknown = np.flatnonzero(np.isnan(course.over_second(ramp)[:, 0]))
        expected = {*range(5), *range(missing, min(missing + 6, len(time_s)))}
        assert {*unknown.tolist()} == expected
        ramp[missing] = 3.0 * time_s[missing]


@pytest.mark.parametrize("late_s", [0.0, 0.1, 0.3, 0.5])
def test_a_gps_is_taken_as_much_earlier_as_fits_the_forces_best(late_s):
    record = coursed(noise=0.0)
    late = samples_of(record) | {name: Samples(record.time_s + late_s, record[name]) for name in GPS_VELOCITY}
    flight = flight_from(record)
    found, known = course_of(flight, late), course_of(flight, samples_of(record))
    there = np.isfinite(found.velocity).all(axis=1)
    assert there.mean() > 0.98
    np.testing.assert_allclose(found.velocity[there], known.velocity[there], atol=0.15)
    if late_s == 0.1:  # without forces it is taken for the usual one
        alone = course_of(flight, {name: each for name, each in late.items() if name not in ACCELEROMETERS})
        at_s = flight.blocks.time_s[5:-5] + 0.1 + 0.15 - late_s
        expected = np.interp(at_s, record.time_s, record["gps_east"])
        np.testing.assert_allclose(alone.read["gps_east"][5:-5], expected, atol=0.1)


def test_without_fifty_blocks_the_usual_delay_is_taken():
    record = coursed(noise=0.0)
    for known_s, delay_s in ((14.0, 0.0), (10.0, 0.15)):
        short = samples_of(record) | {
            name: Samples(record.time_s, np.where(record.time_s > known_s, np.nan, record[name])) for name in ("nx",)
        }
        course = course_of(flight_from(record), short)
        rows = slice(5, round(5 * known_s) - 5)
        at_s = course.flight.blocks.time_s[rows] + 0.1 + delay_s
        expected = np.interp(at_s, record.time_s, record["gps_north"])
        np.testing.assert_allclose(course.read["gps_north"][rows], expected, atol=0.1)


@pytest.mark.parametrize(("step_s", "over_s"), [(0.05, 1.0), (0.5, 2.5)])
def test_noise_is_told_over_a_second_or_five_samples(flight, step_s, over_s):
    time_s = np.arange(0.0, DURATION_S, step_s)
    swings = np.resize([0.7, -0.7], len(time_s)) * (time_s > 50.0)  # second differences of 2.8
    noise = course_of(flight, {"altitude": Samples(time_s, swings / FOOT_M)}).noise["altitude"]
    known = np.where(np.isfinite(noise), noise, 0.0)
    at_s = flight.blocks.time_s
    assert known[at_s < 49.0] == pytest.approx(0.0)
    assert known[(at_s > 50.5 + over_s) & (at_s < 98.0)] == pytest.approx(2.8**2 / 6.0)
    risen_s = at_s[np.argmax(known > 0.99 * 2.8**2 / 6.0)] - at_s[np.argmax(known > 0.0)]
    assert risen_s == pytest.approx(over_s, abs=0.3 + step_s)


def test_true_readings_leave_what_interpolation_makes(exact):
    """Constants are the wind and the field; what varies is far below what a failing sensor is off by."""
    most = {"gps and force": 0.07, "gps and air": 0.3, "gps and altitude": 0.02, "field": 0.05}
    for relation in relations_of(exact):
        assert np.nanstd(relation.values, axis=0).max() < most.get(relation.name, 0.05)
        told = {"gps and air": WIND_M_S, "field": FIELD / np.linalg.norm(FIELD)}.get(relation.name)
        if told is not None:
            for channel in range(3):
                columns, values = relation.regressors[:, channel], relation.values[:, channel]
                there = np.isfinite(columns).all(axis=1) & np.isfinite(values)
                fit = np.linalg.lstsq(columns[there], values[there])[0]
                assert columns[there] @ fit == pytest.approx(values[there], abs=0.15)
    assert len(relations_of(exact)) == 7


def test_an_attitude_that_is_off_turns_what_a_field_is_compared_with(exact):
    (own,) = [each for each in relations_of(exact) if each.name == "field"]
    turned = np.tile([0.0, 0.0, 1.0], (len(exact.flight), 1))  # a degree about the vertical
    changed = np.radians(1.0) * np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]) @ exact.matrices
    expected = -np.einsum("nji,j->ni", changed, FIELD) / np.linalg.norm(FIELD)
    np.testing.assert_allclose(own.response(exact.flight, Effect(turned=turned)), expected, atol=1e-3)


def test_the_noise_of_a_field_is_beside_its_strength_and_of_others_in_their_unit(exact):
    """From a fifth of the least that is a failure on it counts: twice as much is the logarithm of five."""
    for name, least in {"mag_x": 0.1 * exact.strength, "tas": 2.5, "altitude": 5.0}.items():
        noisy = replace(exact, noise={name: np.array([(0.4 * least) ** 2])})
        assert roughness._log_power(noisy, name) == pytest.approx(np.log(5.0))


@pytest.mark.parametrize(("step_s", "is_told"), [(0.25, True), (0.26, False)])
def test_noise_is_told_of_what_reads_four_times_a_second(exact, step_s, is_told):
    slow = replace(exact, steps_s={**exact.steps_s, "altitude": step_s, "nx": step_s})
    assert {"altitude", *ACCELEROMETERS}.issubset(roughness.noise_channels(slow)) == is_told
    assert {"tas"}.issubset(roughness.noise_channels(slow))


# what another unit or frame makes ----------------------------------------------------------------------------------


def told_of(record, *left_out):
    return list(misread.misread(course_from(record, *left_out)))


def changed(record, changes):
    for name, change in changes.items():
        record = record.replace(name, change(record[name]) if callable(change) else change)
    return record


@pytest.mark.parametrize(
    ("factor", "said"),
    [(1.94384, "kt for m/s"), (3.28084, "ft/s for m/s"), (3.6, "km/h for m/s"), (0.514444, "m/s for kt"), (1.0, "")],
)
def test_a_speed_in_another_unit_is_asked_for(factor, said):
    record = coursed()
    told = f"its velocity reads {said}" if said else ""
    for sensor, channels, words in (("gps", GPS_VELOCITY, told), ("tas", ("tas",), told.replace("its velocity", "it"))):
        scaled = changed(record, {name: lambda read: factor * read for name in channels})
        assert told_of(scaled) == ([(sensor, words)] if words else [])
    assert [misread._unit_of(off * factor, misread._SPEED) for off in (0.96, 1.04)] == [said, said]


@pytest.mark.parametrize(("factor", "said"), [(3.28084, "ft for m"), (0.3048, "m for ft"), (-1.0, "depth for height")])
def test_a_height_in_another_unit_is_asked_for(factor, said):
    assert told_of(changed(coursed(), {"altitude": lambda read: factor * read})) == [("altitude", f"it reads {said}")]
    for off, is_told in ((0.89, True), (1.12, True), (0.88, False), (1.13, False)):
        assert misread._unit_of(off * factor, misread._HEIGHT) == (said if is_told else "")
    assert misread._unit_of(np.nan, misread._HEIGHT) == ""


def test_a_factor_is_told_of_a_hundred_blocks_that_are_alike():
    """By both fits, for either is noisy."""
    random = np.random.default_rng(1)
    felt = random.standard_normal(4000)
    for noise, is_told in ((0.9, True), (1.1, False)):  # correlations of 0.74 and 0.67
        found = misread._factor(-2.0 * (felt + noise * random.standard_normal(4000)), felt)
        assert np.isfinite(found) == is_told
        assert not is_told or found == pytest.approx(-2.0 * np.hypot(1.0, noise), rel=0.05)
    assert misread._factor(3.0 * felt[:100], felt[:100]) == pytest.approx(3.0)
    gaps = np.array([[1.0, np.nan], [2.0, 2.0], [3.0, 3.0], [4.0, 4.0]]), np.array([[1.0], [2.0], [np.nan], [4.0]])
    flown = SimpleNamespace(flight=SimpleNamespace(flown=np.array([True, True, True, False])))
    assert [each.tolist() for each in misread._there(flown, *gaps)] == [[[2.0, 2.0]], [[2.0]]]
    assert np.isnan(
        [misread._factor(felt[:99], felt[:99]), misread._factor(felt, 0.0 * felt), misread._factor(0.0 * felt, felt)]
    ).all()


def test_a_velocity_of_other_axes_is_asked_for():
    record = coursed()
    up = {"gps_down": lambda read: -read}
    east = {"gps_north": record["gps_east"], "gps_east": record["gps_north"]}
    for changes, frame in ((up, "north, east and up"), (up | east, "east, north and up")):
        (told,) = told_of(changed(record, changes))
        assert told == ("gps", f"its velocity reads {frame}, and is taken for north, east and down")
    assert told_of(changed(record, east)) == []  # no frame is this


@pytest.mark.parametrize(
    ("forward", "down", "said"),
    [
        (0.0, -2.1, "they read 2.1 g where gravity is one"),
        (0.0, -0.48, "they read 0.48 g where gravity is one"),
        (0.0, -1.9, None),
        (0.0, -0.52, None),
        (0.9, 0.55, "nz reads -1 g where level flight reads 1"),
        (0.9, 0.45, None),
    ],
)
def test_forces_that_no_gravity_makes_are_asked_for(exact, forward, down, said):
    """By a hundred blocks of them."""
    for blocks, is_told in ((100, True), (99, False)):
        there = np.where(np.arange(len(exact.flight)) - 5 < blocks - 5, G_M_S2, np.nan)
        read = exact.read | {"nx": forward * there, "ny": 0.0 * there, "nz": down * there}
        told = dict(misread.misread(replace(exact, read=read)))
        assert told.get("accelerometers") == (said if is_told else None)
        assert not (said and is_told) or len(told) == 1  # nothing that they are held against is asked for


def test_a_steady_airspeed_is_held_against_the_wind():
    """Along one heading changes tell nothing: a wind of more than 12 m/s, and three times what another unit leaves."""
    course, count = course_from(coursed()), len(course_from(coursed()).flight)

    def of(tas_m_s, ground_m_s):
        read = {name: np.full(count, each) for name, each in zip(GPS_VELOCITY, (ground_m_s, 0.0, 0.0), strict=True)}
        read |= {
            "tas": tas_m_s + 0.01 * np.sin(np.arange(count)),
            "wind_north": np.zeros(count),
            "wind_east": np.zeros(count),
        }
        level = np.tile(np.eye(3), (count, 1, 1))
        return [*misread._airspeed(replace(course, read=read, matrices=level))]

    assert of(50.0, 50.0) == of(50.0, 61.0) == []  # 61 would be ... of a wind of 11
    assert of(97.2, 50.0) == [("tas", "it reads kt for m/s")]
    assert of(25.7, 50.0) == [("tas", "it reads m/s for kt")]
    assert of(24.0, 12.4) == []  # 11.6 m/s of wind
    assert of(26.0, 13.4) == [("tas", "it reads kt for m/s")]
    assert of(60.0, 44.0) == []  # 16 of wind, and 13 as another unit
    few = np.where(np.arange(count) < 99, 97.2, np.nan)
    assert of(few, 50.0) == []


# what stands still ------------------------------------------------------------------------------------------------


def held(first_s, last_s, *, step_s=0.1, value=3.0, channel="tas", until_s=60.0, lands_s=None, others=()):
    """Return which channels stand of one that reads a value for a time, and of others: those that failed."""
    found = stood(first_s, last_s, step_s, value, channel, until_s, lands_s, others)
    return [(name, round(a, 1), round(b, 1), reads) for name, (a, b), reads, doubt in found if not doubt]


def stood(first_s, last_s, step_s=0.1, value=3.0, channel="tas", until_s=60.0, lands_s=None, others=()):
    """Return the same, and why others may be healthy."""

    def of(spans, seed):
        time_s = np.arange(0.0, until_s, step_s)
        read = np.random.default_rng(seed).standard_normal(len(time_s))
        for a, b in spans:
            read[(time_s >= a - 1e-9) & (time_s <= b + 1e-9)] = value
        return Samples(time_s, read)

    sensors = {channel: of([(first_s, last_s)], 1)} | {name: of(spans, 2) for name, spans in dict(others).items()}
    return [*standing(sensors, (0.0, lands_s or until_s))]


@pytest.mark.parametrize("channel", ["tas", "alpha", "altitude", "gps_down", "mag_y", "nx"])
def test_a_sensor_stands_that_reads_one_value_for_more_than_ten_seconds(channel):
    assert held(20.0, 30.3, channel=channel) == [(channel, 20.0, 30.3, 3.0)]
    assert held(20.0, 29.8, channel=channel) == []


def test_it_stands_five_times_as_long_as_it_does_otherwise_and_never_from_the_beginning_or_throughout():
    time_s = np.arange(0.0, 60.0, 0.1)
    for often_s, stands in ((3.8, True), (4.3, False)):
        read = np.random.default_rng(1).standard_normal(600)
        read[300:501], read[50 : 50 + round(10 * often_s) + 1] = 3.0, 1.0
        assert bool([*standing({"tas": Samples(time_s, read)}, (0.0, 60.0))]) == stands
    assert held(0.9, 30.0) == []
    assert held(1.2, 30.0) == [("tas", 1.2, 30.0, 3.0)]
    assert held(5.0, 60.0) == []
    assert held(6.2, 60.0) == [("tas", 6.2, 59.9, 3.0)]
    assert held(20.0, 60.0, lands_s=50.0) == [("tas", 20.0, 50.0, 3.0)]


@pytest.mark.parametrize(("count", "stands"), [(20, True), (19, False)])
def test_one_value_is_read_twenty_times(count, stands):
    assert bool(held(19.8, 19.8 + 0.9 * (count - 1) + 0.1, step_s=0.9, until_s=90.0)) == stands


def test_what_stands_together_is_the_logs_and_a_gps_at_a_walk_tells_no_course():
    together = stood(20.0, 35.0, others={"altitude": [(34.0, 50.0)]})
    assert [(each.channel, each.doubt) for each in together] == [
        ("tas", "it reads one value, and so does altitude"),
        ("altitude", "it reads one value, and so does tas"),
    ]
    assert [each.doubt for each in stood(0.9, 30.0)] == ["it reads one value since the flight began"]
    assert len(held(20.0, 33.0, others={"altitude": [(34.0, 50.0)]})) == 2
    both = held(20.0, 35.0, channel="gps_north", others={"gps_down": [(30.0, 50.0)]})
    assert [name for name, *_ in both] == ["gps_north", "gps_down"]  # axes of one sensor
    assert held(20.0, 35.0, channel="gps_east", value=0.0) == []
    assert len(held(20.0, 35.0, channel="gps_down", value=0.0)) == 1
    assert len(held(20.0, 35.0, channel="gps_east", value=0.0, others={"gps_north": [(20.0, 35.0)]})) == 2


# what jumps ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("size", "is_told"), [(2.3, False), (2.8, True), (-2.8, True)])
def test_a_velocity_that_no_force_makes_jumps_by_two_and_a_half_meters_a_second(size, is_told):
    record = coursed()
    broken = record.replace("gps_east", record["gps_east"] + size * (record.time_s >= 50.0))
    found = [*gps_jumps(course_from(broken))]
    assert bool(found) == is_told
    for channel, at_s, by in found:
        assert (channel, at_s, by) == ("gps_east", pytest.approx(50.0, abs=1.6), pytest.approx(size, abs=0.3))


@pytest.mark.parametrize(
    ("at_s", "again", "is_told"),
    [
        (50.0, 0.23, True),
        (50.0, 0.3, False),
        (12.0, 0.0, False),
        (18.5, 0.0, True),
        (83.0, 0.0, True),
        (88.0, 0.0, False),
    ],
)
def test_a_gps_jumps_amid_a_flight_and_at_no_other_time_by_nearly_as_much(at_s, again, is_told):
    record = coursed()
    added = 8.0 * (record.time_s >= at_s) - 8.0 * again * (record.time_s >= 70.0)
    assert bool([*gps_jumps(course_from(record.replace("gps_north", record["gps_north"] + added)))]) == is_told


@pytest.mark.parametrize(("channel", "read"), [("nx", 20.0), ("nz", 0.1), ("ny", np.nan), ("gps_east", np.nan)])
def test_a_jump_is_told_where_nothing_hits_it_turns_it_over_or_is_missing_within_five_seconds(exact, channel, read):
    for beside, is_calm in ((-25, True), (-24, False), (24, False), (25, True)):  # blocks from 40 s on
        values = exact.read[channel].copy()
        values[200 + beside] = read
        assert _is_calm(replace(exact, read=exact.read | {channel: values}), 40.0) == is_calm
    for down, is_calm in ((-15.4, True), (-15.6, False)):  # 1.99 and 2.01 g
        felt = {"nx": 12.0, "ny": 0.0, "nz": down}
        read = exact.read | {name: np.full(len(exact.flight), each) for name, each in felt.items()}
        assert _is_calm(replace(exact, read=read), 40.0) == is_calm


def test_a_change_in_a_gap_is_no_jump_and_one_at_the_edge_of_a_flight_counts():
    time_s = np.arange(0.0, 60.0, 0.1)
    read = np.random.default_rng(1).standard_normal(600)
    read[300:] += 500.0
    whole, missing = Samples(time_s, read), np.ones(600, dtype=bool)
    for gap, is_told in ((1, True), (2, False)):  # two and a half steps
        missing[300 : 300 + gap] = False
        assert bool([*jumps({"altitude": Samples(time_s[missing], read[missing])}, (0.0, 60.0))]) == is_told
        missing[:] = True
    assert [*jumps({"altitude": whole}, (31.0, 60.0))] == []
    for at in (100, 500):  # as the flight begins or ends another jumps as far
        edge = read.copy()
        edge[at:] += 400.0
        for flown_s, is_told in (((10.0, 50.0), False), ((10.05, 49.95), True)):
            assert bool([*jumps({"altitude": Samples(time_s, edge)}, flown_s)]) == is_told
    assert [*jumps({"altitude": Samples(time_s, np.where(time_s < 28.0, np.nan, read))}, (0.0, 60.0))] != []


# a blocked tube -----------------------------------------------------------------------------------------------------


def tube(exact, *, stands_s=25.0, share=1.0, climbs_m=20.0, from_s=40.0, until_s=DURATION_S, again_s=-99.0):
    """Return what is said of an airspeed of which v^2 - 2 g h stands for a time, or two, while it climbs and sinks."""
    time_s = exact.flight.blocks.time_s
    height = climbs_m * np.sin(2.0 * np.pi * time_s / 10.0)
    inside = (time_s >= from_s - 0.1) & (time_s < from_s + stands_s - 0.1) | (abs(time_s - again_s) < 7.5)
    energy = np.where(inside, 0.0, 400.0 * np.sin(2.0 * np.pi * time_s / 7.0))
    speed = np.sqrt(2500.0 + energy + 2.0 * G_M_S2 * np.where(inside, share, 1.0) * height)
    speed[(time_s > until_s - 0.1) | (time_s < (30.0 if until_s < DURATION_S else 0.0) - 0.1)] = np.nan
    return blocked(replace(exact, read=exact.read | {"tas": speed, "altitude": height}))


def test_a_tube_is_blocked_for_twenty_seconds_while_the_altitude_changes(exact):
    (start_s, end_s), read = tube(exact)
    assert (start_s, end_s) == pytest.approx((40.0, 65.0))
    assert read == pytest.approx(50.0 / KNOT_M_S, rel=0.15)
    assert tube(exact, from_s=20.0, stands_s=30.0, again_s=75.0)[0] == pytest.approx((20.0, 50.0))  # longest
    (_, end_s), _ = tube(exact, from_s=70.0, stands_s=40.0)
    assert end_s == exact.flight.blocks.time_s[-1]
    assert tube(exact, stands_s=21.0) is not None
    assert tube(exact, stands_s=18.0) is None
    assert tube(exact, from_s=34.0, stands_s=22.0, until_s=60.0) is not None
    assert tube(exact, from_s=34.0, stands_s=22.0, until_s=59.8) is None  # three windows are too few
    assert tube(exact, share=0.0) is None  # it doesn't follow the altitude
    assert tube(exact, climbs_m=0.4) is not None
    assert tube(exact, climbs_m=0.33) is None
    assert tube(exact, from_s=20.0, stands_s=72.0) is not None
    assert tube(exact, from_s=5.0, stands_s=90.0) is None  # hardly ever anything else


# what stands against a name -----------------------------------------------------------------------------------------


def finding(suspect="nz", kind="bias", onset_s=40.0, end_s=DURATION_S, *, shown_by=None, **rest):
    own = Explanation(suspect=suspect, kind=kind, effect=lambda _: Effect(), is_healthy=suspect == "wind")
    shown_by = (("gps and force", 2, 40.0), ("air and force", 2, 30.0)) if shown_by is None else shown_by
    about = {"first": int(onset_s), "last": int(end_s), "size": 1.0, "interval": (0.9, 1.1), "evidence": 60.0}
    about |= {"onset_range_s": (onset_s, onset_s), "shows_s": onset_s + 5.0}
    return Finding(
        **{**about, "onset_s": onset_s, "end_s": end_s, "ranked": ((own, 0.0),), "shown_by": shown_by, **rest}
    )


def doubt_of(course, one, *rest, bent=()):
    (found, *_) = judged._with_doubts(course, [one, *rest], bent)
    return found.doubt


@pytest.mark.parametrize(
    ("rest", "why"),
    [
        ({}, ""),
        ({"onset_s": 14.9}, "too little is known before it; too little is known beside it"),
        ({"onset_s": 15.1}, ""),
        ({"onset_s": 80.1}, "it begins as the motion ends"),
        ({"onset_s": 79.8}, ""),
        ({"end_s": 54.9}, "it lasts 15 s"),
        ({"end_s": 64.9}, "it passes after 25 s"),
        ({"end_s": 65.1}, ""),
        ({"onset_s": 64.0, "end_s": 79.5}, "it passes after 16 s"),
        ({"onset_s": 64.0, "end_s": 80.1}, ""),  # the motion ends soon
        ({"end_s": 79.5, "kind": "drift"}, "it passes after 40 s"),
        ({"end_s": 80.1, "kind": "drift"}, ""),
        ({"suspect": "altitude", "kind": "drift", "end_s": 70.0, "size": 0.84}, ""),  # 25.2 m are left
        ({"suspect": "altitude", "kind": "drift", "end_s": 70.0, "size": 0.83}, "it passes after 30 s"),
        ({"suspect": "mag_x"}, "motors' currents and iron do the same"),
        ({"suspect": "mag_x", "kind": "noise"}, ""),
        ({"shown_by": (("gps and force", 2, 40.0),)}, "one comparison alone shows it"),
        ({"shown_by": (("gps and force", 2, 40.0), ("air and force", 2, 15.9))}, "one comparison alone shows it"),
        ({"shown_by": (("gps and force", 2, 40.0), ("air and force", 2, 8.0), ("air and force", 1, 8.0))}, ""),
        ({"suspect": "altitude", "shown_by": (("gps and altitude", 0, 40.0),)}, ""),  # either of its two is suspected
    ],
)
def test_a_sensor_is_named_under_rules(exact, rest, why):
    assert doubt_of(exact, finding(**rest)) == why


def test_whom_one_comparison_of_two_sensors_shows_is_either_of_them(exact):
    (found,) = judged._with_doubts(exact, [finding("altitude", shown_by=(("gps and altitude", 0, 40.0),))], ())
    assert judged.sensors_of(found) == ("altitude", "gps")
    own = Explanation(suspect="tas", kind="bias", effect=lambda _: Effect())
    several = finding("nz")
    several = replace(several, ranked=(*several.ranked, (own, 1.0), (replace(own, suspect="alpha"), 2.0)))
    assert doubt_of(exact, several) == "accelerometers, tas or alpha explains it"


@pytest.mark.parametrize(
    ("other", "why"),
    [
        (finding("wind", evidence=1.0, shown_by=(("gps and force", 0, 21.1),)), "wind explains as much beside it"),
        (finding("wind", evidence=1.0, shown_by=(("gps and force", 0, 20.9),)), ""),
        (finding("wind", onset_s=45.0, shown_by=(("gps and force", 0, 30.0),)), ""),  # when it has long shown
        (finding("wind", shown_by=(("field", 0, 99.0),)), ""),
        (finding("wind", onset_s=10.0, end_s=40.0), ""),
        (finding("tas", shown_by=(("air and force", 0, 30.1),)), "one comparison alone shows it"),
        (finding("tas", shown_by=(("air and force", 0, 29.9),)), ""),
    ],
)
def test_beside_what_explains_as_much_nobody_is_named(exact, other, why):
    assert doubt_of(exact, finding(), other) == why


def test_what_is_left_of_a_stronger_error_in_one_comparison_names_nobody(exact):
    one = finding("altitude", shown_by=(("gps and altitude", 0, 40.0),))
    stronger = finding("gps_down", evidence=61.0, shown_by=(("gps and altitude", 0, 50.0), ("gps and force", 2, 50.0)))
    assert doubt_of(exact, one, stronger) == "gps_down explains as much beside it"
    assert doubt_of(exact, one, replace(stronger, evidence=60.0)) == ""


def test_an_attitude_that_is_bent_leaves_no_name_but_of_what_is_its_own(exact):
    assert doubt_of(exact, finding(), bent=["q reads more", "p reads more"]) == "q reads more"
    assert doubt_of(exact, finding("gps_north", "noise"), bent=["q reads more"]) == ""


@pytest.mark.parametrize(("grows", "is_doubted"), [(1.45, False), (1.55, True)])
def test_nothing_is_judged_in_motion_half_as_lively_again(exact, grows, is_doubted):
    """By the liveliest tenth of both."""
    lively = np.where(exact.flight.blocks.time_s >= 39.9, grows, 1.0)
    lively[-5:] = 99.0

    class Flown(SimpleNamespace):
        def __len__(self):
            return len(lively)

    told = Flown(lively=lively, flown=exact.flight.flown, blocks=exact.flight.blocks)
    assert bool(judged._livelier(told, finding())) == is_doubted
    assert judged._livelier(told, finding(first=0, last=86)) == ["too little is known beside it"]
    assert judged._livelier(told, finding(first=0, last=84)) == []
    assert judged._livelier(told, finding(first=40, last=40)) == ["too little is known beside it"]


@pytest.mark.parametrize(
    ("stronger", "share", "is_its_own"), [(0.62, 0.12, True), (0.58, 0.12, False), (9.0, 0.08, False)]
)
def test_a_field_that_is_read_stronger_by_three_fifths_in_a_tenth_is_its_magnetometers(
    exact, stronger, share, is_its_own
):
    rows = np.arange(len(exact.flight))
    inside = (rows >= 200) & (rows < 200 + share * (len(rows) - 200))
    read = {name: exact.read[name] * np.where(inside, 1.0 + stronger, 1.0) for name in MAGNETOMETER}
    read["mag_x"] = np.where(rows % 12 == 0, np.nan, read["mag_x"])
    far = replace(exact, read=exact.read | read)
    assert judged._is_its_own(far, finding("mag_x")) == is_its_own
    for missing in (rows >= 200, rows < 200):  # nothing to compare, or to compare it with
        gap = {"mag_y": np.where(missing, np.nan, read["mag_y"])}
        assert not judged._is_its_own(replace(far, read=far.read | gap), finding("mag_x"))
    assert not judged._is_its_own(far, finding("nz"))
    assert not judged._is_its_own(far, replace(finding("mag_x"), others=("gps",)))


# what is claimed ----------------------------------------------------------------------------------------------------


def test_a_sensor_stands_still_where_it_moves_half_as_much_as_elsewhere(flight):
    time_s = flight.blocks.time_s
    for inside_deg_s, usual_deg_s, moves in (
        (1.6, 2.9, True),
        (1.4, 2.0, False),
        (4.9, 10.0, False),
        (5.1, 10.0, True),
    ):
        lively = np.where((time_s > 40.0) & (time_s < 60.0), inside_deg_s, usual_deg_s)
        own = SimpleNamespace(blocks=flight.blocks, judged=flight.judged, lively=lively)
        assert judged._moves(own, (40.5, 59.5)) == moves
    assert not judged._moves(flight, (0.0, DURATION_S))
    assert not judged._moves(flight, (200.0, 300.0))


@pytest.mark.parametrize(("late_s", "is_jump"), [(4.9, True), (5.1, False), (-4.9, True)])
def test_what_two_seem_to_do_just_when_one_jumps_is_its_jump(late_s, is_jump):
    both = replace(finding("altitude"), others=("gps",))
    assert judged._is_jump(both, [("gps", 40.0 + late_s)]) == is_jump
    assert not judged._is_jump(both, [("tas", 40.0)])
    assert not judged._is_jump(finding("altitude"), [("altitude", 40.0)])


def test_what_sensors_show_by_themselves_are_alarms_once_they_have_stood_or_stayed(exact):
    said = judged.CourseJudged(
        found=(finding("nz", onset_s=70.0),),
        course=exact,
        stands=(Stands("tas", (30.0, 50.0), 80.0), Stands("mag_y", (20.0, 60.0), 1.0)),
        jumped=(("altitude", 60.0, 150.0),),
        asked=(("gps", "it reads ft/s for m/s"),),
    )
    told = [
        (alarm.number, alarm.source, alarm.onset_s, alarm.time_s, alarm.judgements[0].kind) for alarm in said.alarms
    ]
    assert told == [
        (0, "magnetometer", 20.0, 30.0, FROZEN),
        (1, "tas", 30.0, 40.0, FROZEN),
        (2, "altitude", 60.0, 62.0, "bias"),
        (3, "accelerometers", 70.0, 75.0, "bias"),
    ]
    assert [alarm.judgements[0].axis for alarm in said.alarms] == ["mag_y", "", "", "nz"]
    assert [alarm.judgements[0].parameters for alarm in said.alarms][1:3] == [
        {"value": 80.0, "onset_s": 30.0},
        {"size": 150.0, "onset_s": 60.0},
    ]
    ((sensor, span),) = said.unjudged
    assert (sensor, span.start_s, span.end_s) == ("gps", 0.0, exact.flight.blocks.end_s)
    assert said.compared[:2] == ("gps", "accelerometers")


# where sensors are clear --------------------------------------------------------------------------------------------


def scan_of(onset, last, size, deviation, *, channel="tas bias", least=0.0, left=0.0):
    """Return windows of one explanation that are looked at, in a log of 20 cells."""
    suspect, kind = channel.split()
    own = Explanation(suspect=suspect, kind=kind, effect=lambda _: Effect(), least=least)
    column = [np.asarray(each, dtype=float)[:, np.newaxis] for each in (size, deviation)]
    seen = SimpleNamespace(onset=np.array(onset), last=np.array(last), size=column[0], deviation=column[1])
    return SimpleNamespace(
        seen=seen,
        model=SimpleNamespace(cells=20, cell_s=1.0, explanations=[own]),
        left=left + np.zeros((len(onset), 1)),
    )


def test_an_error_hides_that_is_no_larger_than_any_window_leaves_that_began_until_then():
    """A size and as many deviations as make a finding, and a fifth of both, for it may be there and grow."""
    many = np.sqrt(2.0 * 16.0)
    scan = scan_of([12, 4, 8, 8], [20, 20, 20, 16], [0.1, -0.5, 0.2, 9.0], [0.1, 0.1, 0.05, 9.0])
    hidden = cleared._hidden(scan, np.array([4.0]), "tas")
    first, then, last = (1.2 * (size + 2.0 * many * spread) for size, spread in ((0.5, 0.1), (0.2, 0.05), (0.1, 0.1)))
    assert then < last < first
    assert np.isinf(hidden[[*range(4), *range(13, 20)]]).all()
    assert hidden[4:13] == pytest.approx(first)
    rising = cleared._hidden(scan_of([4, 12], [20, 20], [0.1, 0.5], [0.1, 0.1]), np.ones(1), "tas")
    assert rising[4] == pytest.approx(1.2 * (0.1 + many * 0.1))
    assert rising[5:13] == pytest.approx(1.2 * (0.5 + many * 0.1))


@pytest.mark.parametrize(
    ("said", "shows"),
    [
        ({"size": [0.57]}, True),  # 5.66 deviations
        ({"size": [0.56]}, False),
        ({"size": [0.57], "least": 0.6}, False),
        ({"size": [0.1], "left": 48.1}, True),
        ({"size": [0.1], "left": 47.9}, False),
    ],
)
def test_nothing_is_said_from_where_an_error_shows(said, shows):
    hidden = cleared._hidden(scan_of([4], [20], **{"deviation": [0.1], **said}), np.ones(1), "tas")
    assert np.isnan(hidden[4]) == shows
    assert np.isinf(hidden[5])


def test_of_a_level_what_drifts_for_twenty_seconds_hides():
    scan = scan_of([4, 5], [24, 20], [0.1, 9.0], [0.0, 0.0], channel="altitude drift")
    scan.model.cells = 30
    assert np.isnan(cleared._hidden(scan, np.ones(1), "altitude")[4])  # surely 0.1 m/s: so it shows
    shown = scan_of([4], [24], [0.1], [0.1], channel="altitude drift")
    shown.model.cells = 30
    assert cleared._hidden(shown, np.ones(1), "altitude")[4] == pytest.approx(24.0 * (0.1 + np.sqrt(32.0) * 0.1))


def test_a_cell_is_known_in_which_two_relations_that_feel_a_sensor_hold_at_all():
    def product(name, own, counts):
        relation = SimpleNamespace(name=name)
        equation = SimpleNamespace(relation=relation)
        return SimpleNamespace(columns=SimpleNamespace(own=np.array(own)), equation=equation, counts=np.cumsum(counts))

    products = [
        product("gps and air", [0], [0, 5, 5, 0, 0, 1]),
        product("gps and air", [0, 1], [0, 0, 0, 5, 0, 0]),  # another axis of the same
        product("air and force", [0], [0, 5, 0, 1, 0, 1]),
        product("field", [1], [0, 5, 5, 5, 5, 5]),
    ]
    own = [Explanation(suspect=of, kind="bias", effect=lambda _: Effect()) for of in ("tas", "mag_x")]
    model = SimpleNamespace(products=products, explanations=own, cells=5)
    assert cleared._known(model, ["tas"]).tolist() == [True, False, True, False, True]


def test_of_a_level_what_drifts_for_twenty_seconds_hides_whatever_cells_are_long():
    scan = scan_of([4], [14], [0.1], [0.1], channel="altitude drift")
    scan.model.cell_s = 2.0
    assert np.isfinite(cleared._hidden(scan, np.ones(1), "altitude")[4])


def test_two_changes_that_no_gap_parts_tell_a_jump():
    """The flight begins amid a log, and readings are lost beside the jump."""
    random, time_s = np.random.default_rng(1), np.arange(0.0, 200.0, 0.1)
    read = random.standard_normal(len(time_s)) + 500.0 * (time_s >= 99.95)
    there = (time_s < 50.0) | (time_s > 150.0) | ((time_s > 99.85) & (time_s < 100.15)) | (np.abs(time_s - 99.0) < 0.01)
    own = Samples(time_s[there], read[there])
    assert [name for name, _, _ in jumps({"altitude": own}, (50.0, 149.95))] == ["altitude"]


@pytest.mark.parametrize(("count", "is_told"), [(99, False), (100, True)])
def test_a_frame_is_told_by_a_hundred_blocks(monkeypatch, exact, count, is_told):
    felt = np.random.default_rng(1).standard_normal((count, 3))
    monkeypatch.setattr(misread, "_there", lambda *_: (felt * [1.0, 1.0, -1.0], felt))
    assert bool([*misread._gps(exact)]) == is_told
