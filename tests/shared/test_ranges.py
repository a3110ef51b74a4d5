"""What no sensor reads is missing, counted and told, whichever door it comes in at, and never inside a clear span."""

import json

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.files.seals import seal
from gtmbench.values.channels import CHANNELS, limit_of, names_of
from gtmbench.values.ranges import out_of_range
from gtmbench.verdict.timeline import State
from tests.helpers import links, monitors
from tests.helpers.autopilot_logs import ardupilot, imus
from tests.helpers.night import by_day

SIX = ("p", "q", "r", "phi", "theta", "psi")


def flown():
    return monitors.record(4500, seed=5).select(SIX)  # 90 s at 50 Hz


def broken(channel, rows, value):
    values = flown()[channel].copy()
    values[rows] = value
    return flown().replace(channel, values)


@pytest.mark.parametrize("channel", ["p", "phi"])
@pytest.mark.parametrize("value", [1e30, -np.inf])
def test_what_no_sensor_reads_is_missing_and_told_once(channel, value, tmp_path):
    gb.write_log(broken(channel, [2000], value), tmp_path / "log.csv")
    log = gb.open_log(tmp_path / "log.csv")
    (found,) = log.out_of_range
    shown = "1e30" if value > 0 else "-inf"
    assert found.text == f"1 reading of {channel} is {shown}: taken as missing"
    assert abs(log.segments[0][channel][2000] - flown()[channel][2000]) < 5.0  # as of any single sample that is lost


def absurd(time_s, outside):
    """Return when a reading was outside that lies in a second of which more than one in a hundred were, by counting."""
    at_s = []
    for row in np.flatnonzero(outside):
        begins_s = time_s[row] - np.linspace(0.01, 0.99, 5) - 1e-6  # whole seconds: of 100 Hz, of a hundred readings
        seconds = [(time_s >= each_s) & (time_s < each_s + 1.0) for each_s in begins_s]
        at_s += [time_s[row]] * any(outside[second].sum() > 0.01 * second.sum() for second in seconds)
    return at_s


@pytest.mark.parametrize("seed", by_day(range(200), 40))
def test_no_second_with_more_than_one_percent_outside_is_judged(seed):
    """Whatever the rate, also one that wanders or pauses; whichever readings, and however many."""
    random = np.random.default_rng(seed)
    steps = random.choice([1.0, 1.0, 0.2, 3.0], 3000) if seed % 2 else random.choice([1.0, 1.0, 1.0, 300.0], 3000)
    time_s = np.cumsum(steps) / random.choice([1.0, 5.0, 20.0, 100.0, 400.0])
    outside = np.zeros(3000, dtype=bool)
    first, length = random.integers(3000), random.choice([1, 5, 50, 500, 3000])
    outside[first : first + length] = random.random(len(outside[first : first + length])) < random.choice(
        [0.02, 0.2, 1]
    )
    outside[first] = True
    found = out_of_range("q", time_s, outside, 1e30)
    assert found.count == outside.sum()
    bad_s = absurd(time_s, outside)
    assert all(any(start_s <= at_s <= end_s for start_s, end_s in found.spans) for at_s in bad_s)


@pytest.fixture(scope="module")
def all_sensors():
    """Six sensors, accelerometers, vanes, air data, GPS and a magnetometer, at 100 Hz."""
    truth = gb.fly(excitation="multisine", duration_s=60.0, seed=3)
    readings = gb.with_gps(gb.measure(truth, noise="t2", seed=3), truth, gb.Gps(), seed=3)
    return gb.with_magnetometer(readings, truth, gb.Magnetometer(), seed=3)


@pytest.mark.parametrize("seed", by_day(range(8)))
def test_absurd_readings_of_any_sensor_are_told_and_never_in_a_clear_span(seed, all_sensors, tmp_path):
    """Whenever they begin, at whichever rate, of whichever of its readings."""
    random = np.random.default_rng([68, seed])
    record = gb.decimate(all_sensors, int(random.choice([1, 2, 4, 10])))
    channel = str(random.choice(SIX if seed < 4 else record.channels[len(SIX) :]))
    values = record[channel].copy()
    first, length = int(random.integers(len(record))), int(random.choice([1, 10, 100, 1000]))
    outside = np.zeros(len(record), dtype=bool)
    outside[first : first + length] = (random.random(len(record)) < random.choice([0.1, 1.0]))[first : first + length]
    outside[first] = True
    values[outside] = random.choice([1e30, -1e9, np.inf, 1e308])
    gb.write_log(record.replace(channel, values), tmp_path / "log.csv")
    watched = gb.watch_log(tmp_path / "log.csv", "auto")
    clear = [span for row in names_of(channel) for span in watched.timeline.of(row, State.CLEAR)]
    assert clear or channel not in SIX
    assert not [each for each in absurd(record.time_s, outside) if any(span.meets(each, each) for span in clear)]
    (told,) = [line for line in watched.timeline.told if "taken as missing" in line]
    assert told.startswith(f"{outside.sum()} reading")
    assert f" of {channel} " in told


def test_absurd_readings_of_a_further_imu_are_told_and_never_in_a_clear_span(tmp_path):
    first, second = imus(2)
    values = second["q"].copy()
    values[800:900:3] = 1e30
    (tmp_path / "two.bin").write_bytes(ardupilot([first, second.replace("q", values)]))
    timeline = gb.watch_log(tmp_path / "two.bin", "auto").timeline
    clear = timeline.of("q of IMU2", State.CLEAR)
    assert any(span.end_s <= 80.0 for span in clear)
    assert not any(span.meets(80.0, 90.0) for span in clear)
    assert timeline.told == ("34 readings of q of IMU2 are beyond 100000, the first 1e30 at 80 s: taken as missing.",)


def test_a_sensor_that_reads_nothing_else_is_refused(tmp_path):
    gb.write_log(broken("q", slice(None), 1e30), tmp_path / "log.csv")
    with pytest.raises(gb.InputError, match=r"4500 readings of q are beyond 100000, the first 1e30 at 0 s.*unit right"):
        gb.open_log(tmp_path / "log.csv", needs=SIX)


def test_no_fault_is_out_of_range():
    """A gyro that hangs at 400 deg/s, or one of a multicopter that reaches 2000, is broken or fast, not absurd."""
    assert all(limit_of(name) >= 1e4 for name in CHANNELS if name not in ("north", "east"))
    assert gb.calibrate([broken("q", [100], 2000.0)] * 3, bank=gb.bank_between(["p"], ["q"]))


def test_records_to_learn_from_are_held_to_the_same(recwarn):
    with pytest.warns(gb.errors.NoteWarning, match="1 reading of q is 1e30: taken as missing"):
        monitor = gb.calibrate([broken("q", [2000], 1e30)] * 2, bank=gb.bank_between(["p"], ["q"]))
    assert monitor.watch(flown()).alarms == ()
    assert len(recwarn) == 0


def test_an_absurd_angle_on_a_link_is_missing_and_counted(tmp_path):
    record = monitors.record(1200, seed=21)
    values = record["phi"].copy()
    values[600::100] = 1e30
    path = links.saved(tmp_path / "link.tlog", links.packets(record.replace("phi", values)))
    events, link = links.said(gb.live(str(path), monitors.monitor()))
    assert [event.text for event in events if event.kind == "note"] == [
        "a reading of phi is beyond 100000: it is missing, as all such will be"
    ]
    assert link.counts.out_of_range == 6


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("thresholds", 1e-320, r"residuals.p.thresholds, 'mean 0.08 s' is 9.99989e-321; a threshold is 1e-09 or more"),
        ("markov", 0.0, r"residuals.p.operator.markov holds nothing but 0"),
        ("markov", 1e308, r"residuals.p.operator.markov is 1e\+308; it must be a finite number"),
    ],
)
def test_a_monitor_of_absurd_figures_is_refused_in_a_line(key, value, said, tmp_path):
    gb.save_monitor(monitors.monitor(), tmp_path / "m.json")
    document = json.loads((tmp_path / "m.json").read_text())
    own = document["figures"]["residuals"]["p"]
    if key == "markov":
        own["operator"]["markov"] = [[[value for _ in one] for one in lag] for lag in own["operator"]["markov"]]
    else:
        own["thresholds"] = dict.fromkeys(own["thresholds"], value)
    document.pop("digest")
    (tmp_path / "m.json").write_text(json.dumps(seal(document)))
    with pytest.raises(gb.InputError, match=said):
        gb.load_monitor(tmp_path / "m.json")
