"""Who explains a change: an aircraft whose answer is known, its surfaces or its sensors broken."""

from functools import cache

import numpy as np
import pytest

from gtmbench.detectors.surfaces.commanded import Commanded
from gtmbench.detectors.surfaces.equations import Flow
from gtmbench.detectors.surfaces.evidence import change_of, judged, kind_of, suspects_of
from gtmbench.detectors.surfaces.identification import causes_of, identified
from gtmbench.values.channels import COMMANDS, GYROS
from tests.helpers.answering import STEP_S, answering
from tests.helpers.night import by_day

ONSET_S, UNTIL_S, LOOKED_S = 80.0, 76.0, 95.0
FLOW = Flow()
CHANNELS = (*GYROS, *FLOW.channels, *COMMANDS)


@cache
def answer():
    return identified(FLOW, [answering(seed=seed).matrix(CHANNELS) for seed in (20, 21)], STEP_S)


def change(record, *, is_known=True, hides=0.2):
    """Return who explains what changed; `hides`: what a gyro may be off by without being seen elsewhere."""
    values = record.matrix(CHANNELS)[: round(LOOKED_S / STEP_S)]
    frame = answer().frame
    commanded = Commanded(start_s=0.0, period_s=STEP_S, channels=CHANNELS, values=values, frame=frame)
    known = {name: answer().theta[name][causes_of(frame, name)] for name in answer().frame.equations}
    suspects = [*suspects_of(commanded, UNTIL_S, dict.fromkeys(GYROS, hides))]
    return change_of(
        commanded, suspects, UNTIL_S, np.arange(LOOKED_S - 1.0, UNTIL_S, -0.2), known if is_known else None
    )


def from_onset(changed):
    first = round(ONSET_S / STEP_S)
    return lambda values: np.concatenate([values[:first], changed(values)[first:]])


def late(values):
    found = values.copy()
    for row in range(1, len(found)):
        found[row] = found[row - 1] + STEP_S / 0.3 * (values[row] - found[row - 1])
    return found


KINDS = {
    "jam": (lambda values: np.full_like(values, 0.5), 1, 1.0),
    "bias": (lambda values: values + 1.0, 0, -1.0),
    "lag": (late, 2, 0.3),
}


@pytest.mark.parametrize("is_known", by_day([True, False]), ids=["identified before", "of this flight alone"])
@pytest.mark.parametrize(
    ("surface", "kind"),
    by_day([("rudder", "bias"), ("aileron", "jam"), ("elevator", "lag"), ("elevator", "jam"), ("rudder", "lag")]),
)
def test_a_surface_explains_its_fault_with_its_size_and_its_onset(surface, kind, is_known):
    broken, which, size = KINDS[kind]
    found = change(answering(surfaces={surface: from_onset(broken)}), is_known=is_known)
    assert judged(found, LOOKED_S, source=surface).verdict == f"{surface} failed"
    assert kind_of(found.best.sizes, found.best.deviations) == kind
    assert found.best.sizes[which] == pytest.approx(size, abs=max(4.0 * found.best.deviations[which], 0.1))
    assert abs(found.onset_s - ONSET_S) < 4.5 or kind == "bias"  # an offset lasts, so its evidence grows anywhere


@pytest.mark.parametrize(
    ("sensor", "surface", "wrong"),
    by_day([("alpha", "elevator", 3.0), ("beta", "rudder", 1.0), ("ny", "rudder", 0.1), ("nz", "elevator", 0.2)]),
)
def test_a_sensor_of_the_flow_explains_its_own(sensor, surface, wrong):
    record = answering()
    found = change(record.replace(sensor, from_onset(lambda values: values + wrong)(record[sensor])))
    assert found.best.suspect.name == sensor
    assert found.best.sizes[0] == pytest.approx(wrong, rel=0.2)
    assert judged(found, LOOKED_S, source=surface).doubt == f"surface, wind, or a sensor of the flow: {surface}"


def test_a_gyro_that_nothing_else_holds_may_be_behind_a_weak_surface():
    record = answering(surfaces={"elevator": from_onset(np.zeros_like)})
    names = [[each.suspect.name for each in change(record, hides=hides).ranked[:2]] for hides in (0.2, 1e6)]
    assert names[0][0] == "elevator"
    assert "q" in names[1]


def test_who_was_named_stays_named_until_somebody_else_explains_most_of_it():
    found = change(answering(surfaces={"rudder": from_onset(np.zeros_like)}))
    assert judged(found, LOOKED_S, source="rudder", named="rudder").sensor == "rudder"
    assert judged(found, LOOKED_S, source="rudder", named="elevator").sensor == "rudder"
    kept = change(answering())  # nobody explains anything
    assert judged(kept, LOOKED_S, source="rudder", named="elevator").sensor == "elevator"
    assert judged(kept, LOOKED_S, source="rudder").sensor is None
    why = judged(found, LOOKED_S, source="rudder", sensor="a sensor, for kinematics don't hold (r)")
    assert why.verdict == "can't tell: a sensor, for kinematics don't hold (r)"
