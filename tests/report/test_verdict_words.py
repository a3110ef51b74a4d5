"""What is said of a verdict: the first line, the table, data, pictures; of verdicts that are made by hand."""

import json
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtmbench.detectors.alarm import Judgement
from gtmbench.report.figures.log import log_figure
from gtmbench.report.log_findings import reported_sensors
from gtmbench.report.page.flight import flight_page
from gtmbench.report.tables.log import timeline_table
from gtmbench.report.words.timeline import span_lines, timeline_rows
from gtmbench.report.words.verdict import first_line, verdict_lines
from gtmbench.verdict.scope import Scope
from gtmbench.verdict.timeline import SensorSpan, Sizes, State, laid_out
from gtmbench.verdict.verdict import verdict_of
from tests.helpers.logged import jammed
from tests.helpers.timelines import (
    ALL,
    ANGLE,
    END_S,
    GYRO,
    Judged,
    cases,
    clear,
    failed,
    span,
    suspected,
    unjudged,
    verdict,
)

LABELS = [
    (
        "Why",
        "Alarm at 12.00 s by the residual of q (mean 0.16 s), named at 14.20 s; it goes on for as long as it lasts.",
    ),
    ("Read as", "p, q, r from IMU; phi, theta, psi from ATT; 50 Hz."),
    ("Learnt from", "0.0 to 72.0 s of this log, assumed healthy (bank auto)."),
    ("Next", "--details for the rest."),
]
TOLD = "Nothing judges tas, alpha, nx here; --detector cross-check compares them."


def changed(**more):
    """Return claims of which all six sensors are clear, but for what more is claimed of some, or in their place."""
    made = clear()
    for sensor, own in more.items():
        made[sensor] = [*made.get(sensor, []), *own]
    return made


def instead(**own):
    return clear() | own


# ---- the first line ----


def test_where_nothing_was_found_it_says_for_whom_how_long_and_which_size():
    assert first_line(verdict(clear(4.0, 176.0))) == (
        "No fault found in p, q, r, phi, theta, psi: 172 of 180 s judged; "
        "an error of 0.5 deg/s or 2 deg, or a factor of 0.7 would show."
    )
    gyros = verdict(clear(4.0, 176.0), asked=("p", "q", "r"))
    assert first_line(gyros) == (
        "No fault found in p, q, r: 172 of 180 s judged; an error of 0.5 deg/s or a factor of 0.7 would show."
    )
    angle = first_line(verdict(clear(), asked=("phi",)))
    assert angle == "No fault found in phi: 180 of 180 s judged; an error of 2 deg would show."


def sized(**sizes):
    return first_line(verdict({name: [span(State.CLEAR, sizes=each)] for name, each in sizes.items()}, asked=(*sizes,)))


def test_the_sizes_are_the_worst_and_never_better_than_they_are():
    loud = Sizes(error=1.234, within_s=60.0, factors=(0.678, 1.51))
    assert sized(p=GYRO, q=loud).endswith("; an error of 1.3 deg/s or a factor below 0.67 or above 1.6 would show.")
    assert sized(p=GYRO, phi=ANGLE, psi=Sizes(error=7.0, within_s=60.0)).endswith(
        "; an error of 0.5 deg/s or 7 deg, or a factor of 0.7 would show."
    )
    assert sized(p=Sizes(error=0.5, within_s=60.0, factors=(0.6, 1.5))).endswith(
        "an error of 0.5 deg/s or a factor below 0.6 or above 1.5 would show."
    )


def test_a_factor_that_would_not_show_is_said():
    blind = Sizes(error=0.5, within_s=60.0)
    assert sized(p=blind, q=blind).endswith("; an error of 0.5 deg/s would show; a wrong factor would not show.")
    assert sized(p=GYRO, q=GYRO, r=blind).endswith(
        "; an error of 0.5 deg/s or a factor of 0.7 would show; a wrong factor of r would not show."
    )
    assert sized(p=GYRO, q=None).endswith("would show; which fault of q would show is not known.")


def test_a_failure_is_said_with_its_span_and_kind_and_who_is_clear():
    assert first_line(verdict(changed(q=[failed("q", 100.0, 112.3, parameters={"size": 3.02})]))) == (
        "The pitch gyro (q) failed from 100.0 to 112.3 s: bias 3.02 deg/s. p, r, phi, theta, psi are clear."
    )
    lasting = failed("psi", 80.0, END_S, kind="jam", parameters={"value": 49.4}, intervals={"value": (49.3, 49.5)})
    assert first_line(verdict(changed(psi=[lasting]), asked=("q", "psi"))) == (
        "The heading (psi) failed from 80.0 s on: jam at 49.4 ± 0.1 deg. q is clear."
    )
    unknown = failed("p", 0.0, END_S, kind="unknown", parameters={})
    assert first_line(verdict(changed(p=[unknown]), asked=("p",))) == "The roll gyro (p) failed from beginning to end."


def test_several_failures_are_said_in_time_each_with_its_spans():
    both = changed(r=[failed("r", 20.0, 30.0), failed("r", 50.0, 60.0)], p=[failed("p", 40.0, 90.0, kind="noise")])
    assert first_line(verdict(both)).startswith(
        "The yaw gyro (r) failed from 20.0 to 30.0 s and from 50.0 to 60.0 s: bias 3 deg/s; "
        "the roll gyro (p) failed from 40.0 to 90.0 s: noise 3 deg/s. q, phi,"
    )
    many = changed(**{name: [failed(name, 10.0 * place, 60.0)] for place, name in enumerate(ALL)})
    said = first_line(verdict(many))
    assert said.count(" failed ") == 3
    assert said.endswith("; and 3 more.")


def test_what_else_is_known_of_a_failure_is_said():
    imu = failed("q", 30.0, END_S, imu="IMU2")
    assert first_line(verdict(changed(q=[imu]))).startswith("The pitch gyro (q) of IMU2 failed from 30.0 s on: bias")
    axis = failed("magnetometer", 30.0, END_S, kind=None, parameters={}, axis="mag_y")
    assert first_line(verdict(changed(magnetometer=[axis]))) == (
        "The magnetometer failed from 30.0 s on, its y axis. p, q, r, phi, theta, psi are clear."
    )
    lost = span(State.FAILED, 20.0, 40.0, reason="it lost its fix")
    assert first_line(verdict(changed(gps=[lost]))).startswith(
        "The GPS failed from 20.0 to 40.0 s: it lost its fix. p,"
    )
    swap = {"kind": "swap", "parameters": {}, "partner": "q"}
    turned = changed(p=[failed("p", 60.0, END_S, **swap)], q=[failed("p", 60.0, END_S, **swap)])
    assert first_line(verdict(turned)).startswith(
        "The roll gyro (p) and the pitch gyro (q) have changed places from 60.0 s on. r, phi"
    )
    towards = failed("p", 60.0, 70.0, kind="misalignment", parameters={"angle_deg": 5.0}, partner="q")
    assert "misalignment 5 deg towards q" in first_line(verdict(changed(p=[towards])))


def test_a_suspicion_names_the_set_once():
    either = [suspected(["p", "phi"], 80.0, END_S)]
    assert first_line(verdict(changed(p=either, phi=either))) == (
        "One of the roll gyro (p) and bank angle (phi) failed from 80.0 s on: cannot tell which. "
        "q, r, theta, psi are clear."
    )
    three = [suspected(["p", "q", "phi"], 80.0, 90.0)]
    assert first_line(verdict(changed(p=three, q=three, phi=three))).startswith(
        "One of p, q and phi failed from 80.0 to 90.0 s: cannot tell which. "
    )
    alone = [suspected(["q"], 80.0, 90.0, reason="the detector names no sensor")]
    assert first_line(verdict(changed(q=alone))).startswith(
        "The pitch gyro (q) may have failed from 80.0 to 90.0 s: the detector names no sensor. p, r,"
    )


def test_a_suspicion_that_nobody_asked_about_stays_out_of_the_first_line():
    either = [suspected(["tas", "gps"], 80.0, 90.0)]
    found = verdict(changed(tas=either, gps=either))
    assert first_line(found).startswith("No fault found in p, q, r, phi, theta, psi: 180 of 180 s judged")
    assert {"tas", "gps"} <= {row.sensor for row in timeline_rows(found)}


def test_it_says_for_whom_nobody_can_tell_and_why():
    constant = [unjudged("the heading never changes")]
    assert first_line(verdict(instead(r=constant, psi=constant))) == (
        "Cannot tell for r and psi: the heading never changes. p, q, phi, theta are clear."
    )
    two = verdict(instead(p=[unjudged("too noisy", 0.0, 110.0), *clear(110.0)["p"]], psi=constant))
    assert first_line(two) == (
        "Cannot tell for p: too noisy (70 of 180 s judged); for psi: the heading never changes. "
        "q, r, phi, theta are clear."
    )
    loud = instead(q=[span(State.CLEAR, sizes=Sizes(error=7.2, within_s=60.0))])
    assert first_line(verdict(loud)).startswith("Cannot tell for q: only an error of 7.2 deg/s or more would show. p,")
    assert first_line(verdict(clear(), asked=("p", "tas"))).startswith(
        "Cannot tell for tas: the log has no such sensor. p is clear."
    )


def test_a_cause_of_all_sensors_is_said_once():
    why = "the attitude contradicts the gyros."
    assert (
        first_line(verdict({name: [unjudged(why)] for name in ALL}))
        == "Cannot tell: the attitude contradicts the gyros."
    )
    assert first_line(verdict(clear(), motion_s=())) == "Cannot tell: nothing moves."
    assert first_line(verdict(clear(), asked=())).startswith("Cannot tell: no sensor is asked")


def test_failures_beside_sensors_that_arent_judged_are_both_told():
    constant = [unjudged("the heading never changes")]
    made = instead(r=constant, psi=constant, tas=[failed("tas", 30.0, 60.0, kind=None)])
    assert first_line(verdict(made)) == (
        "The airspeed (tas) failed from 30.0 to 60.0 s. Cannot tell for r and psi: the heading never changes. "
        "p, q, phi, theta are clear."
    )
    after = changed(q=[failed("q", 20.0, 30.0), unjudged("what follows the fault", 30.0, END_S)])
    assert "deg/s. q is not judged in 150 of 180 s: what follows the fault. p, r," in first_line(verdict(after))


def test_who_is_clear_in_a_part_is_said_so():
    made = clear(0.0, 144.0) | {"q": [failed("q", 0.0, 20.0), *clear(20.0)["q"]]}
    assert first_line(verdict(made)).endswith(". p, r, phi, theta, psi are clear in the 144 of 180 s that are judged.")


def test_suspicions_of_who_was_not_asked_come_after_whom_nobody_can_tell():
    judgement = Judgement(time_s=1.0, sensor=None, candidates=("q", "tas"), kind="bias")
    both = SensorSpan(start_s=0.0, end_s=100.0, state=State.SUSPECTED, suspects=("q", "tas"), judgement=judgement)
    rows = {"q": [both], "p": [unjudged("nothing predicts it here", 0.0, END_S)], "tas": [both]}
    judged = verdict_of(laid_out((0.0, END_S), rows, motion_s=[(0.0, END_S)]), Scope(sensors=("p",)))
    assert judged.exit_code == 3
    assert first_line(judged).startswith("Cannot tell: nothing predicts it here. One of the pitch gyro (q) and")


@given(cases())
def test_the_first_line_begins_as_the_exit_code_says_and_names_every_asked_sensor(case):
    judged = verdict_of(*case)
    said = first_line(judged)
    assert said.startswith("No fault found in ") == (judged.exit_code == 0)
    assert judged.exit_code != 3 or said.startswith("Cannot tell")
    named = set(re.findall(r"\w+", said))
    common = re.search(r"Cannot tell: ", said)
    assert common or set(judged.scope.sensors) <= named
    for sensor in re.findall(r"[\w, ]+(?= (?:is|are) clear)", said):
        for name in re.findall(r"\w+", sensor):
            assert not judged.timeline.of(name, State.FAILED, State.SUSPECTED)


# ---- the table ----


@given(cases(), st.integers(60, 160), st.sampled_from([(), (TOLD,), (TOLD, TOLD.replace("tas", "gps"))]))
def test_twelve_lines_fit_a_screen(case, width, told):
    timeline, scope = case
    judged = verdict_of(type(timeline)(**{**vars(timeline), "told": told}), scope)
    lines = verdict_lines(judged, LABELS, width)
    assert len(lines) <= 12
    assert max(map(len, lines)) <= width
    assert first_line(judged).startswith(lines[0].removesuffix(" ..."))


def test_every_asked_sensor_has_a_row_and_others_where_they_say_something():
    made = changed(
        q=[failed("q", 100.0, 112.3)], tas=[failed("tas", 20.0, END_S)], nx=[unjudged("nothing predicts it")]
    )
    made["r"] = [unjudged("too noisy", 0.0, 20.0), *clear(20.0)["r"]]
    rows = {row.sensor: row for row in timeline_rows(verdict(made))}
    assert list(rows) == [*ALL, "tas"]
    assert rows["p"][1:] == ("clear", "0.5 deg/s, a factor of 0.7")
    assert rows["q"][1:] == ("failed 100.0-112.3 s; clear", "bias 3 deg/s; elsewhere 0.5 deg/s, a factor of 0.7")
    assert rows["r"][1:] == ("clear 160 s", "0.5 deg/s, a factor of 0.7; not judged: too noisy")
    assert rows["tas"].state == "failed 20.0 s on"


def test_the_kind_of_a_suspicion_is_said_of_the_likeliest_alone():
    either = [suspected(["p", "phi"], 80.0, END_S)]
    rows = {row.sensor: row.why for row in timeline_rows(verdict({"p": either, "phi": either}, asked=("p", "phi")))}
    assert rows["p"].startswith("it or phi: bias")
    assert rows["phi"].startswith("it or p: both explain it")


def test_where_there_are_more_rows_than_lines_those_that_found_nothing_give_way():
    made = clear() | {f"strain_{i}": clear()["p"] for i in range(9)} | {"strain_7": [failed("strain_7", 20.0, 30.0)]}
    lines = verdict_lines(verdict(made, asked=(*made,)), LABELS)
    assert len(lines) == 12
    assert any(line.startswith("strain_7  failed 20.0-30.0 s") for line in lines)
    assert any(re.fullmatch(r"\.\.\. and \d+ more: --details", line) for line in lines)
    assert lines[-1] == "Next         --details for the rest."


def test_nothing_is_lost_in_the_details():
    made = changed(q=[failed("q", 100.0, 112.3), unjudged("what follows the fault", 112.3, 130.0)])
    made["strain_9"] = [unjudged("a reason that is much longer than any line of any screen is wide, " * 3)]
    found = verdict(made, told=[TOLD])
    text = "\n".join([*verdict_lines(found, LABELS, 80, None), *span_lines(found.timeline)])
    assert " ..." not in text
    assert all(label[1].split()[-1] in text for label in LABELS)
    assert "100.00 to 112.30  failed: bias 3 deg/s" in text
    assert "112.30 to 130.00  not judged: what follows the fault" in text
    assert "130.00 to 180.00  clear: 0.5 deg/s, a factor of 0.7, noise of 1.2 deg/s within 60 s" in text
    assert made["strain_9"][0].reason.strip() in text


def test_one_reason_for_all_needs_no_table():
    lines = verdict_lines(verdict({name: [unjudged("axes are turned")] for name in ALL}, told=[TOLD]), LABELS)
    assert lines[:2] == ["Cannot tell: axes are turned.", TOLD]


# ---- data and pictures ----


def test_the_data_hold_every_span_with_what_is_known_of_it():
    made = changed(q=[failed("q", 100.0, 112.3)], p=[suspected(["p", "phi"], 20.0, 30.0)])
    table = json.loads(json.dumps(timeline_table(verdict(made, told=[TOLD], factor=0.7))))
    assert (table["span_s"], table["motion_s"], table["motion_total_s"]) == ([0.0, 180.0], [[0.0, 180.0]], 180.0)
    assert (table["asked"], table["told"], table["judged_s"]) == ([*ALL], [TOLD], 180.0)
    assert table["limits"] == {"error_deg_s": 5.0, "error_deg": 10.0, "factor": 0.7, "judged_share": 0.75}
    first, found, last = table["sensors"]["q"]
    assert (first["state"], first["error"], first["unit"], first["within_s"]) == ("clear", 0.5, "deg/s", 60.0)
    assert (first["factor_below"], first["factor_above"], first["noise"]) == (0.7, 1.3, 1.2)
    assert (found["start_s"], found["end_s"], found["state"], found["kind"]) == (100.0, 112.3, "failed", "bias")
    assert (found["parameters"]["size"], found["parameter_units"]["size"]) == (3.0, "deg/s")
    assert (found["error"], found["factor_below"], last["end_s"]) == (None, None, 180.0)
    assert table["sensors"]["p"][1]["suspects"] == ["p", "phi"]
    assert table["sensors"]["phi"][0]["unit"] == "deg"
    assert table["sensors"]["phi"][0]["factor_below"] is None


@given(cases())
def test_what_a_sensor_is_judged_for_adds_up(case):
    judged = verdict_of(*case)
    table = timeline_table(judged)
    asked = table["asked"]
    lost = max(judged.timeline.motion_in(sensor, State.NOT_JUDGED) for sensor in asked)
    assert table["judged_s"] == pytest.approx(table["motion_total_s"] - lost)


def several():
    """Return a watched log whose verdict has all four states."""
    made = {"p": [*clear(0.0, 60.0)["p"], failed("p", 100.0, 102.0)], "theta": [suspected(["theta", "q"], 30.0, 60.0)]}
    return Judged(jammed(), verdict(clear(0.0, 170.0) | made | {"tas": [failed("tas", 20.0, 40.0, kind=None)]}))


def test_the_figure_has_a_bar_a_sensor_in_four_colours_and_where_faults_began(tmp_path):
    from matplotlib.image import imread

    watched = several()
    figure = log_figure(watched)
    axis = figure.axes[0]
    assert [label.get_text() for label in axis.get_yticklabels()] == [*ALL, "tas", "remarks"]
    _, names = axis.get_legend_handles_labels()
    assert {"clear", "failed", "suspected", "not judged", "fault began, estimated"} <= {*names}
    begun = [tuple(line.get_xdata()) for line in axis.get_lines() if line.get_label() == "fault began, estimated"]
    assert begun == [(100.0,), (30.0,), (20.0,)]
    figure.savefig(tmp_path / "log.png", dpi=60)
    picture = imread(tmp_path / "log.png")[:, :, :3].reshape(-1, 3)
    for colour in ("b3261e", "f0a030", "d3d6da", "8ccf9f"):
        wanted = [int(colour[place : place + 2], 16) / 255.0 for place in (0, 2, 4)]
        assert (abs(picture - wanted).max(axis=1) < 0.02).sum() > 300, colour


def test_the_page_has_a_bar_a_sensor_and_the_table():
    page = flight_page(several(), "gtmbench monitor flight.csv")
    assert "http" not in page.replace("http-equiv", "")  # it asks nothing of a network
    assert "url(" not in page
    assert "default-src 'none'" in page
    figure = page.partition('class="panel timeline"')[2].partition("</figure>")[0]
    assert re.findall(r'<span title="[^"]*" style="top: [\d.]+%">(\w+)</span>', figure) == [*ALL, "tas"]
    assert {"clear", "failed", "suspected", "not_judged"} == set(re.findall(r'class="state (\w+)"', figure))
    assert "<title>p, 100.0 to 102.0 s: failed: bias 3 deg/s</title>" in figure
    assert figure.count('class="onset"') == 3
    assert "failed 100.0-102.0 s; clear 60 s" in page


def test_whoever_isnt_asked_and_found_nothing_is_in_no_picture():
    found = verdict(changed(tas=clear()["p"], nx=[failed("nx", 20.0, 40.0)]), asked=("q", "nowhere"))
    assert reported_sensors(found) == ("q", "nx")
