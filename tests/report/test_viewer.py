"""A look at the recording in the real viewer, as a person would take it."""

import sys
import time
from pathlib import Path

import numpy as np
import pytest

from gtmbench.report.recording.write import write_log_recording
from tests.helpers.logged import watched_log
from tests.helpers.monitors import monitor, record
from tests.helpers.watching import drift, study

VULKAN = [path for folder in ("/usr/share/vulkan", "/etc/vulkan") for path in Path(folder).glob("icd.d/*.json")]


pytestmark = [
    pytest.mark.viewer,
    pytest.mark.skipif(not VULKAN, reason="the viewer needs a Vulkan driver (Debian: mesa-vulkan-drivers libvulkan1)"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),  # of the viewer's own process handling
]
COLOURS = {"p": (31, 119, 180), "q": (224, 130, 20), "r": (42, 157, 74), "threshold": (214, 39, 40)}


@pytest.mark.nightly
def test_the_viewer_shows_lines_in_the_colours_of_the_trials(recording_of):
    assert not missing(COLOURS, recording_of(drift), 400.0)


@pytest.mark.nightly
def test_the_viewer_opens_a_study_of_a_bank_with_the_decision(recording_of):
    assert not missing({**COLOURS, "virtual sensor": (214, 64, 159)}, recording_of(study), 70.0)


def missing(colours, path, time_s):
    """Return the names of the colours in which nothing is drawn."""

    def missed(picture):
        return [name for name, colour in colours.items() if close(picture, colour) <= 150]

    return missed(looked_at(path, time_s, lambda picture: not missed(picture)))


def close(picture, colour):
    return (np.abs(picture - np.array(colour)).max(axis=2) < 40).sum()


def looked_at(path, time_s, is_drawn):
    """Return a recording's picture in the viewer, 0 to 255, shape (rows, columns, 3).

    A busy machine's viewer may pause amid a recording for longer than any wait: a second after the first picture
    that `is_drawn`, or after a minute.
    """
    import socket

    from rerun.experimental import ViewerClient

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    program = str(Path(sys.executable).parent / "rerun")
    with ViewerClient.spawn(headless=True, port=port, hide_welcome_screen=True, executable_path=program) as viewer:
        viewer.open(str(path))
        viewer.set_time("time", duration=time_s, play_state="paused")
        deadline = time.monotonic() + 60.0
        picture = pixels(viewer)
        while not is_drawn(picture) and time.monotonic() < deadline:
            time.sleep(1.0)
            picture = pixels(viewer)
        time.sleep(1.0)  # and once more: what holds amid loading has to hold after it
        return pixels(viewer)


def pixels(viewer):
    from io import BytesIO

    from matplotlib.image import imread

    return (imread(BytesIO(viewer.take_screenshot()), format="png")[:, :, :3] * 255).astype(int)


@pytest.mark.nightly
def test_the_viewer_draws_no_line_over_a_gap(tmp_path):
    """Bank, pitch and heading in a log of three minutes whose second is missing: that third of a plot is empty."""
    flight = record(9000, seed=5)
    parts = [flight.between(0.0, 60.0), flight.between(120.0, 179.98)]
    path = tmp_path / "log.rrd"
    write_log_recording(watched_log(parts, parts, monitor()), path)

    def drawn(picture):
        """Columns with a line of p's colour below the levels' legend."""
        is_p = np.abs(picture - np.array(COLOURS["p"])).max(axis=2) < 40
        return np.flatnonzero(is_p[300:].any(axis=0))

    def on_both_sides(columns):
        return len(columns) > 300 and np.diff(columns).max() > 0.25 * (columns[-1] - columns[0])

    picture = looked_at(path, 175.0, lambda picture: on_both_sides(drawn(picture)))
    assert on_both_sides(drawn(picture))
