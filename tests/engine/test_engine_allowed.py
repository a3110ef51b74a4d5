"""What is health to the engine and what a failure, in units that a reader knows: a change here is a decision."""

from dataclasses import replace

import numpy as np
import pytest

from gtmbench.engine.course.course import course_of
from gtmbench.engine.course.explanations.registry import explanations_of as of_course
from gtmbench.engine.course.relations.registry import relations_of as relations_of_course
from gtmbench.engine.course.relations.roughness import LEAST
from gtmbench.engine.explanations.registry import explanations_of
from gtmbench.engine.relations import rest
from gtmbench.engine.relations.registry import relations_of
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, GPS_VELOCITY, GYROS, MAGNETOMETER
from tests.engine.course.coursing import coursed, flight_from, samples_of
from tests.engine.engine_flights import felt_at_rest
from tests.engine.test_engine_parts import FLIGHT, ROWS, imu, standing

INF = np.inf
FELT = replace(FLIGHT, forces=felt_at_rest(FLIGHT.angles))

# constants' standard deviations over logs, and within one; by how much means of seconds wander; the least noise
HEALTH = {
    # deg/s of offset, shares of turns, s of lag, deg/s that references pull by a deg
    "attitude": ([3.0, 0.1, 0.1, 0.1, 0.1, 0.03], [0.1, 0.02, 0.02, 0.02, 0.01, 0.01], 0.2, 0.0),
    "gravity": ([10.0] * 4, [1.0] * 4, 2.0, 0.0),  # deg
    "roughness": ([10.0, 1.0, 1.0], [0.2, 0.05, 0.08], 0.8, 0.0),
    "between IMUs: IMU2": ([3.0, 0.1, 0.1, 0.1, 0.1], [0.07, 0.02, 0.02, 0.02, 0.01], 0.05, 0.02),
    "between IMUs: roughness of IMU2": ([10.0, 0.5, 1.0], [0.2, 0.05, 0.08], 0.3, 0.0),
    "rest": ([3.0], [0.1], 0.1, 0.0),
}
HEALTH_OF_COURSE = {
    "gps and force": ([0.5, 0.5, 0.5, 0.3], [0.05] * 4, 0.3, 0.05),  # m/s2
    "gps and air": ([15.0, 15.0, 1.0, 0.05], [0.7, 0.7, 0.2, 0.01], 1.0, 0.3),  # m/s of wind; a scale
    "gps and altitude": ([0.3], [0.05], 0.2, 0.05),  # m/s
    "air and force": ([0.5, 0.5, 0.5, 0.3, 0.5], [0.05, 0.05, 0.05, 0.05, 0.2], 0.5, 0.2),
    "altitude and force": ([0.5, 0.5, 0.5, 0.3], [0.05] * 4, 0.3, 0.1),
    "field": ([1.0, 1.0, 1.0, 0.2, 0.2, 1.0], [0.01] * 6, 0.02, 0.005),  # shares of the field
    "roughness": ([10.0, 1.0], [0.2, 0.08], 0.3, 0.1),
}


@pytest.mark.parametrize("of", ["flight", "course"])
def test_constants_of_health(of):
    if of == "flight":
        stood = rest.relation(standing(100, 300))
        found = (*relations_of(replace(FELT, imus=(imu(FLIGHT.gyros),))), stood)
    else:
        found = relations_of_course(course_of(flight_from(coursed()), samples_of(coursed())))
    told = {
        each.name: (pytest.approx(each.prior), pytest.approx(each.floor), each.wander, each.least) for each in found
    }
    expected = HEALTH if of == "flight" else HEALTH_OF_COURSE
    assert {each.name for each in found if each.is_witness} <= {"gravity"}  # it feels every acceleration
    assert {each.name for each in found if each.is_of_axes} == {*expected} & {"attitude", "between IMUs: IMU2"}
    assert all(each.is_witness for each in found if each.name == "gravity")
    assert {name: (list(a), list(b), *rest_) for name, (a, b, *rest_) in expected.items()} == told


def bounds(each):
    return each.price, each.low, each.high, each.reach, each.least, each.shortest_s, each.is_healthy


@pytest.mark.parametrize(("is_driven", "is_assumed"), [(False, False), (True, True), (True, False)])
def test_sizes_of_failures_of_gyros_and_angles_and_of_healthy_causes(is_driven, is_assumed):
    """Nats, and deg/s, deg, shares or s: of an angle that gyros are known to drive nothing but a heading fails."""
    is_sure = is_driven and not is_assumed
    expected = {"clock lag": (0.0, -1.0, 1.0, INF, 0.005, 0.0, True)}
    expected |= {f"compass iron {name}": (0.0, -40.0, 40.0, INF, 1.0, 0.0, True) for name in ("north", "east")}
    for lean in ("lean of bank", "lean of pitch", "lean"):
        expected[f"references {lean}"] = (0.0, -0.3, 0.6, INF, 0.005, 0.0, True)
    for gyro in GYROS:
        expected[f"{gyro} noise"] = (8.0, 0.0, INF, INF, 1.5, 0.0, False)
        for fades_s in (2.5, 7.0, 16.0):
            most = 0.9 if gyro == "r" else 0.7
            expected[f"references turns of {gyro} over {fades_s:g} s"] = (0.0, 0.0, most, INF, 0.05, 0.0, True)
    for angle in ATTITUDE:
        most = INF if angle == "psi" else 40.0
        expected[f"{angle} step"] = (INF if is_sure else 1.0, -max(most, 60.0), max(most, 60.0), INF, 2.0, 0.0, False)
        is_pulled = is_sure and angle != "psi"
        drift = f"references drift of {angle}" if is_pulled else f"{angle} drift"
        expected[drift] = (1.0, -INF, INF, most, 0.1, 7.0, is_pulled)
        scale = f"references scale of {angle}" if is_sure else f"{angle} scale"
        expected[scale] = (3.0 if is_sure else 1.0, -4.0, 3.0, INF, 0.12, 7.0, is_sure)
    found = explanations_of(replace(FELT, is_driven=is_driven, is_assumed=is_assumed))
    assert {each.name: bounds(each) for each in found if each.name in expected} == expected
    mirrors = {each.name: each.mirror for each in found if each.is_gain or each.kind.startswith("scale")}
    own = {name: 1.0 for name in mirrors if name[:7] in ("p scale", "q scale", "r scale")}  # its noise explains itself
    scaled = {name: -1.0 for name in mirrors if "scale" in name and name not in own}
    assert {name: mirror for name, mirror in mirrors.items() if np.isfinite(mirror)} == own | scaled
    kinds = {each.kind for each in found if each.suspect in GYROS}
    assert {"bias", "drift", "scale", "deadzone", "noise"} <= kinds
    dead = next(each for each in found if each.name == "p deadzone")
    assert dead.high == pytest.approx(2.0 * FLIGHT.gyros.std(axis=0).max() + 1.0)


def test_sizes_of_failures_of_other_sensors_and_of_what_changes_in_health():
    """In m/s2, m/s, shares of the field, deg and m; what drifts does so for a minute."""
    sizes = dict.fromkeys(ACCELEROMETERS, (0.7, 40.0)) | dict.fromkeys(GPS_VELOCITY, (1.0, 1000.0))
    sizes |= dict.fromkeys(MAGNETOMETER, (0.05, 3.0)) | dict.fromkeys(("alpha", "beta"), (1.5, 60.0))
    sizes |= {"tas": (2.0, 100.0), "altitude": (5.0, 5000.0)}
    expected = {}
    for name, (least, most) in sizes.items():
        expected[f"{name} bias"] = (0.0, -most, most, INF, least, 0.0, False)
        expected[f"{name} drift"] = (1.0, -INF, INF, most, pytest.approx(least / 60.0), 10.0, False)
        expected[f"{name} noise"] = (8.0, 0.0, INF, INF, pytest.approx(np.log(26.0)), 0.0, False)  # of a fifth as much
    changes = {"wind wind_north": (0.5, 20.0), "wind wind_east": (0.5, 20.0), "attitude phi": (1.0, 10.0)}
    for name, (least, most) in (changes | {"attitude theta": (1.0, 10.0), "attitude psi": (1.0, 40.0)}).items():
        expected[f"{name} changes"] = (0.0, -most, most, INF, least, 0.0, True)
        expected[f"{name} drifts"] = (0.0, -INF, INF, most, pytest.approx(least / 60.0), 0.0, True)
    course = course_of(flight_from(coursed()), samples_of(coursed()))
    assert expected == {each.name: bounds(each) for each in of_course(course)}
    lasts = {each.kind.split()[-1] for each in of_course(course) if each.lasts}
    assert lasts == {"bias", "drift", "noise", "drifts"}  # a gust is in one part alone
    noises = dict.fromkeys(GPS_VELOCITY, 1.0) | dict.fromkeys(MAGNETOMETER, 0.1) | {"altitude": 5.0, "tas": 2.5}
    assert noises | dict.fromkeys(("alpha", "beta"), 1.5) | dict.fromkeys(ACCELEROMETERS, 0.980665) == pytest.approx(
        LEAST
    )


def test_standing_for_ten_seconds_tells_an_offset():
    assert rest.relation(standing(100, 100 + 15 + 49)) is not None
    assert rest.relation(standing(100, 100 + 15 + 45)) is None
    values = rest.relation(standing(100, 200)).values
    assert np.isfinite(values).all(axis=1).sum() == 86
    assert len(values) == ROWS
