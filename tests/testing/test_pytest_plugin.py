"""The pytest plugin, as a project that has it installed sees it: fixtures, marker, messages, recordings, processes."""

import re
import shutil
import xml.etree.ElementTree as ET

import pytest

from tests.helpers.watching import EXAMPLE
from tests.report.test_report import read_back
from tests.testing.test_testing import verified

pytest_plugins = ["pytester"]

FAILING = """
    import numpy as np
    import pytest
    import gtmbench as gb
    from gtmbench.testing import assert_detects, assert_quiet, assert_residual

    HEALTHY = gb.Record(np.random.default_rng(1).standard_normal((900, 2)), channels=["p", "r"], sample_period_s=0.01)
    OPERATOR = gb.identify(HEALTHY, inputs=["p"], outputs=["r"], causal_order=0, noncausal_order=0)

    def test_well():
        assert_residual(HEALTHY, OPERATOR, below=100)

    @pytest.mark.parametrize("name", ["p", "../../p", "../../p "])
    def test_silent(name):
        assert_detects(lambda record: [], gb.Jam(channel="p", onset_s=3), within_s=0.5, record=HEALTHY)

    class TestLoud:
        def test_silent(self):
            assert_residual(HEALTHY, OPERATOR, below=0.25)
"""
COUNTING = """
    import pytest
    from gtmbench.testing import shared_flights

    def fly(*arguments, really=shared_flights.fly):
        with open({log!r}, "a") as log:
            log.write(repr(arguments) + "\\n")
        return really(*arguments)

    shared_flights.fly = fly
"""
FLYING = """
    import gtmbench as gb
    from gtmbench.testing import standard_record

    def test_fly(fly_once, gtm_flight, gtm_record):
        assert fly_once() is gtm_flight
        short = fly_once(duration_s=2.0, seed=5)
        assert (short.values == gb.fly("gtm", "multisine+turbulence", 2.0, 5).values).all()
        assert gtm_record is standard_record()
        assert (gtm_record.end_s, gtm_record.values.shape) == (200.0, (20_001, 13))

    def test_fly_again(fly_once, gtm_flight):
        assert fly_once() is gtm_flight
        fly_once(seed=5, duration_s=2)
"""


@pytest.fixture
def project(pytester, monkeypatch):
    """Return a function that runs pytest in a project of its own, with our plugin and no other, warnings as errors."""
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    monkeypatch.setenv("CI", "1")  # or the summary's lines are cut to the terminal's width
    for name in ("PYTEST_ADDOPTS", "PYTEST_XDIST_WORKER"):
        monkeypatch.delenv(name, raising=False)

    def run(*arguments):
        strict = ("-W", "error", "--strict-markers", "--strict-config", "-p", "no:cacheprovider")
        return pytester.runpytest_subprocess("-p", "gtmbench.pytest_plugin", *strict, *arguments)

    return run


def recordings(pytester, folder="gtmbench-artefacts"):
    return sorted((pytester.path / folder).glob("*"))


@pytest.mark.nightly
def test_a_failure_names_figure_bound_and_recording_and_the_recording_is_whole(pytester, project):
    """In every process."""
    pytester.makepyfile(test_mine=FAILING)
    result = project("-p", "xdist", "-n", "2", "--junitxml=report.xml", "-q")
    result.assert_outcomes(passed=1, failed=4)
    result.stdout.fnmatch_lines(
        [
            "FAILED test_mine.py::test_silent[[]p] - AssertionError: jam of p from 3.00 s: no alarm until the record's "
            "end at 8.99 s (allowed: within 0.5 s); recording: gtmbench-artefacts/test_mine-test_silent-p-????????.rrd",
            "FAILED test_mine.py::TestLoud::test_silent - AssertionError: residual of r reached 3.* deg/s at *.?? s "
            "(allowed: below 0.25 deg/s); recording: gtmbench-artefacts/test_mine-TestLoud-test_silent-????????.rrd",
        ]
    )
    assert ">       assert_residual(HEALTHY, OPERATOR, below=0.25)\nE       AssertionError: " in result.stdout.str()
    kept = recordings(pytester)
    assert len(kept) == 4
    assert len(list(pytester.path.rglob("*.rrd"))) == 4
    for path in kept:
        assert verified(path)
        assert result.stdout.str().count(f"{path}\n") == 1, "the report's section"
    told = [one.get("value") for one in ET.parse(pytester.path / "report.xml").iterfind(".//property")]
    assert sorted(told) == [str(path) for path in kept]
    loud = next(path for path in kept if "Loud" in path.name)
    assert len(read_back(loud, "/residuals/r")[0]) == 900


@pytest.mark.nightly
def test_an_outsiders_detector_goes_through(pytester, project):
    """The whole of a project's test file, with the example of the documentation: by its class, and by its name."""
    shutil.copy(EXAMPLE, pytester.path / "limits.py")
    pytester.makepyfile(
        test_limits="""
        import gtmbench as gb
        from gtmbench.testing import assert_detects, assert_quiet

        DETECTOR = "limits.py:LimitCheck"
        JAM, DRIFT = gb.Jam(channel="p", onset_s=120), gb.Drift(channel="p", onset_s=120, slope=5.0)

        def test_quiet():
            assert_quiet(DETECTOR)

        def test_drift(gtm_record):
            assert_detects(DETECTOR, DRIFT, within_s=40, record=gtm_record)

        def test_jam():
            assert_detects(gb.find_detector(DETECTOR), JAM, within_s=10)
        """
    )
    result = project("-q")
    result.assert_outcomes(passed=2, failed=1)
    late = "jam of p from 120.00 s: no alarm until the record's end at 200.00 s (allowed: within 10 s)"
    missed = "the score reached * % of its threshold; recording: gtmbench-artefacts/test_limits-test_jam-*.rrd"
    result.stdout.fnmatch_lines([f"FAILED test_limits.py::test_jam - AssertionError: {late}; {missed}"])
    (kept,) = recordings(pytester)
    assert verified(kept)
    assert len(read_back(kept, "/levels/p")[0]) > 1000


@pytest.mark.nightly
def test_the_artefacts_folder_is_an_option_and_what_passes_leaves_nothing(pytester, project):
    pytester.makepyfile(test_mine=FAILING)
    project("-k", "well").assert_outcomes(passed=1, deselected=4)
    assert not list(pytester.path.rglob("*.rrd")) + recordings(pytester)
    project("--gtmbench-artefacts=out/here", "-k", "Loud").assert_outcomes(failed=1, deselected=4)
    assert len(recordings(pytester, "out/here")) == 1
    assert not recordings(pytester)


@pytest.mark.nightly
def test_an_assertion_in_a_fixture_or_caught_is_kept_too(pytester, project):
    pytester.makepyfile(
        test_mine="""
        import pytest
        from gtmbench import Record
        from gtmbench.testing import assert_quiet

        RECORD = Record([1.0, 2.0], channels=["p"], sample_period_s=1.0)

        @pytest.fixture
        def broken():
            assert_quiet(lambda _: [1.0], RECORD)

        def test_a(broken):
            pass

        def test_b():
            for _ in range(2):
                with pytest.raises(AssertionError):
                    assert_quiet(lambda _: [1.0], RECORD)
        """
    )
    project().assert_outcomes(errors=1, passed=1)
    names = {re.sub("-[0-9a-f]{8}", "", path.stem) for path in recordings(pytester)}
    assert names == {"test_mine-test_a", "test_mine-test_b", "test_mine-test_b-2"}


@pytest.mark.nightly
def test_slow_flights_wait_until_they_are_wanted(pytester, project):
    pytester.makepyfile(
        """
        import pytest

        @pytest.mark.slow_flight
        def test_slow():
            pass

        @pytest.mark.parametrize("hours", [1, pytest.param(9, marks=pytest.mark.slow_flight)])
        def test_some(hours):
            pass
        """
    )
    result = project("-rs")
    result.assert_outcomes(passed=1, skipped=2)
    result.stdout.fnmatch_lines(["SKIPPED * a slow flight; --gtmbench-slow runs it"])
    project("--gtmbench-slow").assert_outcomes(passed=3)
    project("--gtmbench-slow", "-m", "not slow_flight").assert_outcomes(passed=1, deselected=2)


@pytest.mark.nightly
def test_a_flight_is_flown_once_a_session_however_many_processes(pytester, project):
    """With ``--dist each``, every process runs every test, at the same time."""
    log = pytester.path / "flown.log"
    pytester.makeconftest(COUNTING.format(log=str(log)))
    pytester.makepyfile(test_a=FLYING, test_b=FLYING)
    project("-p", "xdist", "-n", "2", "--dist", "each").assert_outcomes(passed=8)
    flown = [f"('gtm', 'multisine+turbulence', {arguments})" for arguments in ("2.0, 5", "200.0, 100000")]
    assert sorted(log.read_text().splitlines()) == sorted(flown)


@pytest.mark.nightly
def test_whoever_doesnt_use_it_doesnt_notice_it(pytester, project):
    """Collecting and running tests of something else: no warnings, no clutter, nothing heavy imported."""
    pytester.makepyfile(
        test_other="""
        import sys

        def test_light():
            heavy = {"numpy", "scipy", "pandas", "rerun", "jsbsim", "matplotlib", "filelock"}
            assert not heavy & set(sys.modules)
        """
    )
    result = project("-v")
    result.assert_outcomes(passed=1)
    assert "gtmbench" not in re.sub(r"rootdir: .*|configfile: .*", "", result.stdout.str())
    assert project("--collect-only", "-q").ret == 0
    assert not list(pytester.path.glob("gtmbench*"))


def test_help_fixtures_and_markers_say_what_there_is(project):
    assert re.search(r"--gtmbench-slow .*\n *--gtmbench-artefacts=DIR\n", project("--help").stdout.str())
    project("--markers").stdout.fnmatch_lines(["@pytest.mark.slow_flight: flies for long; *"])
    shown = project("--fixtures").stdout.str()
    for name in ("fly_once", "gtm_flight", "gtm_record"):
        assert re.search(rf"^{name} \[session scope\].*\n    [A-Z].*\.$", shown, flags=re.MULTILINE), name
