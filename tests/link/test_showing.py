"""A flight is drawn while it is watched: what was judged, and never at the watch's cost."""

import os
import signal
import time

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.link.showing import Showing
from gtmbench.report.recording.read import read_recording
from tests.helpers import links, monitors

BIAS = gb.Bias(channel="q", onset_s=250.0, size=4.0)


@pytest.fixture(scope="module")
def flight():
    """A flight that is longer than what a drawing looks back at, with a fault near its end."""
    return gb.inject(monitors.record(14_000, seed=31), BIAS)


@pytest.mark.nightly
def test_a_recording_holds_what_the_watch_judged(flight, tmp_path):
    """Readings bit for bit; residuals and levels as of the whole flight, up to the alarm, though drawn bit by bit."""
    showing = Showing(monitors.monitor(), tmp_path / "live.rrd", waits=True)
    for k in range(0, len(flight), 7):
        showing.rows(flight.part(range(k, min(k + 7, len(flight)))))
    drawn = showing.end({"outcome": "failed"})
    assert (drawn.paths, drawn.left_out, drawn.failure) == ((tmp_path / "live.rrd",), 0, "")
    table, watch = read_recording(drawn.paths[0]), monitors.monitor().watch(flight)
    assert watch.alarms

    def line(root, name):
        rows = table[table["entity"].astype(str).str.startswith(root) & (table["series"] == name)]
        assert rows["time_s"].is_unique
        return rows["time_s"].to_numpy(), rows["value"].to_numpy()

    for name in ("p", "q", "psi"):
        at, values = line("/sensors", name)
        np.testing.assert_allclose(at, flight.time_s, atol=1e-9)
        np.testing.assert_array_equal(values, flight[name])
    before_s = watch.alarms[0].onset_s - 1.0
    for name, score in watch.scores.items():
        at, values = line("/levels", name)
        known = (score.known_s < before_s) & np.isfinite(score.values)
        assert known.sum() > 10_000
        np.testing.assert_allclose(at[at < before_s], score.known_s[known], atol=1e-9)
        np.testing.assert_allclose(values[at < before_s], (score.values / score.threshold)[known], rtol=1e-6)
    assert table[table["entity"] == "/verdict"]["text"].tolist() == ["failed"]


@pytest.mark.nightly
def test_a_link_is_recorded_with_what_was_said_and_each_clock_has_a_file(tmp_path):
    """An autopilot that reboots begins its clock anew: lines would run backwards."""
    record = gb.inject(monitors.record(3000, seed=21), gb.Bias(channel="q", onset_s=45.0, size=4.0))
    again = [(at + 70.0, packet) for at, packet in links.packets(monitors.record(1500, seed=22))]
    path = links.saved(tmp_path / "reboot.tlog", [*links.packets(record), *again])
    link = gb.live(path.as_posix(), monitors.monitor(), record=tmp_path / "live.rrd")
    with link:
        said = [event for event in link if event.time_s is not None]
    (drawn,) = link.drawn
    assert [path.name for path in drawn.paths] == ["live.rrd", "live-2.rrd"]
    first, second = map(read_recording, drawn.paths)
    told = [*first[first["entity"] == "/events"]["text"], *second[second["entity"] == "/events"]["text"]]
    assert sorted(told) == sorted(f"{event.time_s:.2f} s  {event.kind}: {event.text}" for event in said)
    assert set(first["entity"]) >= {"/alarm", "/named", "/threshold", "/virtual/q"}
    assert link.verdict in second[second["entity"] == "/verdict"]["text"].tolist()


@pytest.mark.nightly
def test_a_watch_goes_on_where_nobody_draws(flight, tmp_path):
    """A process that hangs takes nothing: rows are left out, counted, and handing them over takes no time."""
    showing = Showing(monitors.monitor(), tmp_path / "live.rrd", waits=False)
    os.kill(showing.pid, signal.SIGSTOP)
    longest_s = 0.0
    values, most = flight.values[:10], 6000
    for k in range(most):
        rows = gb.Record(values, channels=flight.channels, sample_period_s=0.02, start_s=0.2 * k)
        began_s = time.perf_counter()
        showing.rows(rows)
        longest_s = max(longest_s, time.perf_counter() - began_s)
    os.kill(showing.pid, signal.SIGCONT)
    drawn = showing.end({})
    assert longest_s < 1.0  # it waits for nothing; other processes may
    assert 0 < drawn.left_out < 10 * most
    assert not drawn.failure


@pytest.mark.nightly
def test_a_watch_goes_on_where_the_drawing_dies(tmp_path):
    record = gb.inject(monitors.record(3000, seed=21), gb.Bias(channel="q", onset_s=45.0, size=4.0))
    path = links.saved(tmp_path / "flight.tlog", links.packets(record))
    without, _ = links.said(gb.live(path.as_posix(), monitors.monitor()))
    link = gb.live(path.as_posix(), monitors.monitor(), record=tmp_path / "live.rrd")
    first = next(link)
    os.kill(link._pictures._showings[0].pid, signal.SIGKILL)
    with link:
        said = [first, *link]
    assert links.told(said) == links.told(without) != []
    assert "ended too early" in link.drawn[0].failure
