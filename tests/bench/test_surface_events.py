"""A surface that a watch names in a loop: an event, and word to the controller; the flight is as it would have been."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.bench.loop_flight import ControllerError
from gtmbench.errors import InputError

LEVEL_S = 1.0


class Scripted:
    """A watch that names the rudder, later with a kind, and keeps what it was shown."""

    def start(self, sample_period_s):
        assert sample_period_s == 0.01
        self.shown = []

        def step(time_s, readings, commands):
            self.shown.append((time_s, *readings, *commands))
            return {100: {"rudder": None}, 150: {"rudder": "jam"}}.get(len(self.shown), {})

        return step


class Listening:
    """Holds the trim, and keeps what it is told."""

    heard: list = []  # noqa: RUF012

    def start(self, trim):
        self.level, type(self).heard = list(trim.commands.values()), []

    def command(self, readings, time_s):
        return self.level

    def told(self, event):
        self.heard.append((event.time_s, event.channel, event.fault))


def test_a_watch_is_shown_what_is_read_and_commanded_and_changes_nothing():
    watch = Scripted()
    flight = gb.fly_in_loop("gtm", "doublets+turbulence", 3.0, seed=3, watch_surfaces=watch)
    alone = gb.fly_in_loop("gtm", "doublets+turbulence", 3.0, seed=3)
    np.testing.assert_array_equal(flight.truth.values, alone.truth.values)
    shown = np.array(watch.shown)
    np.testing.assert_allclose(shown[:, 0], flight.sensed.time_s[:-1], atol=1e-9)
    np.testing.assert_array_equal(shown[:, 1:], flight.readings(commands=True).values[:-1])
    assert [(round(event.time_s, 2), event.kind, event.channel, event.fault) for event in flight.events] == [
        (0.99, "surface failed", "rudder", None),
        (1.49, "surface failed", "rudder", "jam"),
    ]


def test_a_controller_that_listens_is_told():
    gb.fly_in_loop(duration_s=2.0, controller=Listening, watch_surfaces=Scripted())
    assert Listening.heard == [(pytest.approx(0.99), "rudder", None), (pytest.approx(1.49), "rudder", "jam")]


def test_a_controller_that_fails_when_it_is_told_has_what_was_flown():
    class Deaf(Listening):
        def told(self, event):
            raise RuntimeError("no")

    with pytest.raises(ControllerError, match=r"controller 'Deaf' at 1 s: RuntimeError: no"):
        gb.fly_in_loop(duration_s=2.0, controller=Deaf, watch_surfaces=Scripted())


def test_only_a_monitor_of_surfaces_watches_them():
    with pytest.raises(InputError, match="give a calibrated one of detector 'surfaces'"):
        gb.WatchSurfaces(gb.FunctionDetector(len).calibrate())
