"""Hypothesis draws the same examples in every run, and rerun asks the network nothing."""

import gc
import os
from functools import cache, lru_cache

import pytest
from hypothesis import settings

import gtmbench as gb
from gtmbench.bench.flight import fly
from gtmbench.cli.app import main
from gtmbench.files.shipped import share
from gtmbench.log import watch
from gtmbench.log.judging import certificate
from gtmbench.log.judging.certificate import ONSETS
from gtmbench.method.regression import triangle
from gtmbench.report.recording.read import read_recording
from gtmbench.report.recording.write import write_recording
from gtmbench.study import flights, healthy_records
from tests.helpers.watched_once import remembered
from tests.helpers.watching import written_once

os.environ.setdefault("CI", "1")

settings.register_profile("day", derandomize=True, deadline=None, max_examples=40)
settings.register_profile("night", settings.get_profile("day"), max_examples=100)


LONG_EXAMPLES = {  # of docstrings, which take two seconds and more
    "gtmbench.detectors.accommodation.without_sensor.Accommodate",
    "gtmbench.detectors.surfaces.in_loop.WatchSurfaces",
    "gtmbench.detectors.surfaces.surfaces.SurfaceDetector",
    "gtmbench.detectors.surfaces.surfaces.SurfaceMonitor",
    "gtmbench.detectors.surfaces.surfaces.SurfaceMonitor.sizes",
    "gtmbench.engine.course.detector.CrossCheck",
    "gtmbench.link.live.live",
    "gtmbench.report.fleet_report.watch_fleet",
    "gtmbench.study.reference.detection_reference",
}


def pytest_configure(config):
    """Draw more examples where nothing is left to the night."""
    settings.load_profile("day" if config.option.markexpr == "not nightly" else "night")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Leave to the night what can't carry a mark."""
    for item in items:
        if item.name in LONG_EXAMPLES:
            item.add_marker(pytest.mark.nightly)


def pytest_collection_finish():
    """What is loaded by now stays: going through it for garbage again and again takes a twentieth of the suite."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(100_000, 50, 100)


@pytest.fixture(scope="session", autouse=True)
def _flown_once():
    """Studies that ask for a flight again get the same one: `test_same_flight` holds that it would be, bit for bit."""
    shelf = lru_cache(maxsize=16, typed=True)(fly)

    def flown(aircraft, *arguments, **point):
        return (shelf if aircraft == "gtm" else fly)(aircraft, *arguments, **point)

    with pytest.MonkeyPatch.context() as patch:
        for module in (flights, healthy_records):
            patch.setattr(module, "fly", flown)
        yield


@pytest.fixture(scope="session", autouse=True)
def _certified_at_few_onsets():
    """A log's certificate is most of the work of what is told of it; `test_certificate` holds the whole ones."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(certificate, "ONSETS", 3)
        yield


@pytest.fixture
def whole_certificates(monkeypatch):
    """Have logs certified as they are for users: at as many onsets."""
    monkeypatch.setattr(certificate, "ONSETS", ONSETS)


@pytest.fixture(scope="session", autouse=True)
def _watched_once():
    """Commands that watch a log in the same way again get the same one; `watched_anew` watches it again."""
    _ = gb.watch_log  # which is taken where it is defined when it is first asked for, and isn't meant
    patched, shelf = remembered(watch.watch_log)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(watch, "watch_log", patched)
        yield shelf


@pytest.fixture
def watched_anew(_watched_once):
    """Return a function that makes commands watch logs anew."""
    return _watched_once.clear


@pytest.fixture(scope="session")
def recording_of(tmp_path_factory):
    """Return a function that writes the recording of a study, as made by a function, once, and gives its path."""
    return written_once(write_recording, tmp_path_factory.mktemp("recordings"))


@pytest.fixture(scope="session")
def frame_of(recording_of):
    """Return a function that reads such a recording, once."""
    return cache(lambda study: read_recording(recording_of(study)))


@pytest.fixture
def copied_gtm(tmp_path):
    """Return a function that copies the GTM under a name, as a user would, and gives the copy's folder."""

    def copy(name):
        folder = tmp_path / "fleet" / name
        folder.mkdir(parents=True)
        source = share() / "aircraft/gtm"
        for part in ("aircraft.toml", "gtm-tables.xml"):
            (folder / part).write_text((source / part).read_text())
        (folder / f"{name}.xml").write_text((source / "gtm.xml").read_text().replace('name="gtm"', f'name="{name}"'))
        return folder

    return copy


@pytest.fixture
def cli(capsys, tmp_path, monkeypatch):
    """Run a command line in an empty folder; return its exit code, stdout and stderr."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        with pytest.raises(SystemExit) as ended:
            main([str(argument) for argument in arguments])
        return ended.value.code, *capsys.readouterr()

    return run


@pytest.fixture
def grams(monkeypatch):
    """Count Gram matrices."""
    calls = []
    gram = triangle.gram
    monkeypatch.setattr(triangle, "gram", lambda *args: calls.append(args) or gram(*args))
    return calls
