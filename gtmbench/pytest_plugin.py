"""The pytest plugin: fixtures that fly once a session, a marker for slow flights, recordings of what failed.

Installing gtmbench is enough. pytest imports this module in every run, so what is heavy waits until a fixture is used.

- fixtures: `gtm_flight`, `gtm_record`, `fly_once`; they hold over the processes of pytest-xdist, too
- assertions: ``from gtmbench.testing import assert_residual, assert_detects, assert_quiet``
- ``@pytest.mark.slow_flight``: skipped unless ``--gtmbench-slow`` is given
- ``--gtmbench-artefacts DIR``: where the recordings of assertions that fail go
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from gtmbench.files.artefacts import Artefacts, artefacts_in, file_name

if TYPE_CHECKING:
    from gtmbench.values.record import Record

_ARTEFACTS = pytest.StashKey[Artefacts]()
_SLOW = "slow_flight"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add two options, in a group of their own."""
    group = parser.getgroup("gtmbench", "gtmbench, aircraft sensor faults")
    group.addoption("--gtmbench-slow", action="store_true", help=f"run tests that are marked {_SLOW}, too")
    group.addoption(
        "--gtmbench-artefacts",
        metavar="DIR",
        default="gtmbench-artefacts",
        help="where the recordings (.rrd) of assertions that failed go, from the rootdir (default: %(default)s)",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Declare the marker."""
    config.addinivalue_line("markers", f"{_SLOW}: flies for long; skipped unless --gtmbench-slow is given")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Skip slow flights unless they are wanted."""
    if config.getoption("gtmbench_slow"):
        return
    for item in items:
        if item.get_closest_marker(_SLOW):
            item.add_marker(pytest.mark.skip(reason="a slow flight; --gtmbench-slow runs it"))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Tell assertions and fixtures where this test leaves its artefacts."""
    folder = item.config.rootpath / item.config.getoption("gtmbench_artefacts")
    test = Artefacts(folder=folder, name=file_name(item.nodeid), flights=_shared(item.config))
    item.stash[_ARTEFACTS] = test
    with artefacts_in(test):
        return (yield)


def _shared(config: pytest.Config) -> Path | None:
    """Return where the workers of pytest-xdist share flights: beside their temporary folders, gone with these."""
    own = config.getoption("basetemp", None) if hasattr(config, "workerinput") else None
    return Path(own).parent / "gtmbench-flights" if own else None


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Name the recordings in the failure's report, and as properties in JUnit's XML."""
    test = item.stash.get(_ARTEFACTS, Artefacts())  # none, where another plugin runs tests in its own way
    paths = [str(path) for path in test.recordings]
    item.user_properties += [("gtmbench_recording", path) for path in paths if not _is_listed(item, path)]
    report = yield
    if report.failed:
        report.sections += [("gtmbench recording", path) for path in paths]
    return report


def _is_listed(item: pytest.Item, path: str) -> bool:
    return any(value == path for _, value in item.user_properties)


@pytest.fixture(scope="session")
def fly_once() -> Callable[..., Record]:
    """Fly, once a session for the same arguments: fly_once(excitation="doublets", duration_s=60, seed=7); truth."""
    from gtmbench.testing.shared_flights import fly_once

    return fly_once


@pytest.fixture(scope="session")
def gtm_flight(fly_once: Callable[..., Record]) -> Record:
    """Return the GTM's standard flight: 200 s of multisine in moderate turbulence, truth of all channels."""
    return fly_once()


@pytest.fixture(scope="session")
def gtm_record() -> Record:
    """Return what the T2's sensors read on the standard flight: healthy, noise included."""
    from gtmbench.testing.shared_flights import standard_record

    return standard_record()
