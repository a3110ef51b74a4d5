"""A look at the recording in the real viewer, as a person would take it."""

import sys
import time
from pathlib import Path

import numpy as np
import pytest

from gtmbench.report.recording.write import write_log_recording
from tests.logged import watched_log
from tests.monitors import monitor, record
from tests.watching import drift, several, study

VULKAN = [path for folder in ("/usr/share/vulkan", "/etc/vulkan") for path in Path(folder).glob("icd.d/*.json")]


pytestmark = [
    pytest.mark.viewer,
    pytest.mark.skipif(not VULKAN, reason="the viewer needs a Vulkan driver (Debian: mesa-vulkan-drivers libvulkan1)"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),  # of the viewer's own process handling
]
COLOURS = {"p": (31, 119, 180), "q": (224, 130, 20), "r": (42, 157, 74), "threshold": (214, 39, 40)}


def test_the_viewer_shows_lines_in_the_colours_of_the_trials(recording_of):
    picture = looked_at(recording_of(drift), 400.0)
    for name, colour in COLOURS.items():
        assert close(picture, colour) > 150, f"no line in the colour of {name}"


def test_the_viewer_opens_a_study_of_a_bank_with_the_decision(recording_of):
    picture = looked_at(recording_of(study), 70.0)
    for name, colour in {**COLOURS, "virtual sensor": (214, 64, 159)}.items():
        assert close(picture, colour) > 150, f"no line in the colour of {name}"


def test_the_viewer_opens_a_study_of_several_detectors(recording_of):
    """The first one's tab, whose norms lie on each other but that of r."""
    picture = looked_at(recording_of(several), 70.0)
    for name in ("r", "threshold"):
        assert close(picture, COLOURS[name]) > 150, f"no line in the colour of {name}"


def close(picture, colour):
    return (np.abs(picture - np.array(colour)).max(axis=2) < 40).sum()


def looked_at(path, time_s):
    """Return a recording's picture in the viewer, 0 to 255, shape (rows, columns, 3)."""
    import socket
    from io import BytesIO

    from matplotlib.image import imread
    from rerun.experimental import ViewerClient

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    program = str(Path(sys.executable).parent / "rerun")
    with ViewerClient.spawn(headless=True, port=port, hide_welcome_screen=True, executable_path=program) as viewer:
        viewer.open(str(path))
        viewer.set_time("time", duration=time_s, play_state="paused")
        picture = settled(viewer)
    return (imread(BytesIO(picture), format="png")[:, :, :3] * 255).astype(int)


def settled(viewer):
    """Return a screenshot once two in a row agree and something is drawn."""
    last = b""
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        time.sleep(1.0)
        now = viewer.take_screenshot()
        if now == last and len(now) > 60_000:
            return now
        last = now
    return last


def test_the_viewer_draws_no_line_over_a_gap(tmp_path):
    """Bank, pitch and heading in a log of three minutes whose second is missing: that third of a plot is empty."""
    flight = record(9000, seed=5)
    parts = [flight.between(0.0, 60.0), flight.between(120.0, 179.98)]
    path = tmp_path / "log.rrd"
    write_log_recording(watched_log(parts, parts, monitor()), path)
    picture = looked_at(path, 175.0)
    is_p = np.abs(picture - np.array(COLOURS["p"])).max(axis=2) < 40
    columns = np.flatnonzero(is_p[300:].any(axis=0))  # below the levels' legend
    assert len(columns) > 300
    assert np.diff(columns).max() > 0.25 * (columns[-1] - columns[0])
