"""The built wheel, alone: installed into an environment of its declared dependencies, run in an empty directory."""

import json
import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from importlib.metadata import PathDistribution, distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from uv import find_uv_bin

from gtmbench import save_monitor
from studies.compiled import compiler
from tests.helpers.monitors import monitor

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Return the built wheel."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(folder), str(ROOT)]
    subprocess.run(build, check=True, timeout=300)
    (built,) = folder.glob("gtmbench-*.whl")
    return built


def needed(of, closure=()):
    """Return the names of what a distribution declares that it needs, and of what that needs in turn."""
    names = set(closure)
    for line in of.requires or ():
        requirement = Requirement(line)
        if requirement.name not in names and (requirement.marker is None or requirement.marker.evaluate({"extra": ""})):
            names |= needed(distribution(requirement.name), {*names, requirement.name})
    return names


def link(names, folder):
    """Lay distributions of this environment into another's folder: what `pip install` copies, without copying it."""
    for installed in map(distribution, names):
        for top in {file.parts[0] for file in installed.files} - {"..", "__pycache__"}:
            if not (folder / top).is_symlink():
                (folder / top).symlink_to(installed.locate_file(top))


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """Return the commands' folder of a fresh environment that holds the wheel, what it declares, and nothing else."""
    folder = tmp_path_factory.mktemp("alone") / "fresh"
    venv.create(folder, symlinks=True)
    commands, site = folder / "bin", Path(sysconfig.get_path("purelib", "venv", {"base": str(folder)}))
    link(needed(PathDistribution(zipfile.Path(wheel) / f"{'-'.join(wheel.name.split('-')[:2])}.dist-info")), site)
    pip = [sys.executable, "-m", "pip", "--python", commands / "python"]
    subprocess.run([*pip, "install", "--quiet", "--no-deps", "--no-index", wheel], check=True, timeout=60)
    subprocess.run([*pip, "check"], check=True, timeout=60, capture_output=True)
    return commands


def own_environment():
    """Return the environment without what points to another Python's modules."""
    return {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}


@pytest.mark.nightly
def test_the_wheel_runs_the_main_job_in_an_empty_directory(installed, tmp_path):
    run = [installed / "gtmbench", "run", "--json"]
    done = subprocess.run(
        run, cwd=tmp_path, env=own_environment(), capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    results = json.loads(done.stdout)
    assert [trial["detected"] for trial in results["trials"]] == [True] * 15
    assert {"results.json", "trials.csv", "study.rrd", "markov.png"} <= {
        path.name for path in (tmp_path / "study").iterdir()
    }
    assert {path.name for path in tmp_path.iterdir()} == {"study"}


@pytest.mark.nightly
def test_the_wheel_brings_its_data_and_the_name_of_what_ships_works_anywhere(installed, tmp_path):
    script = (
        "import gtmbench as gb; from gtmbench.files.shipped import share;"
        "print('_share' in str(share()), len(gb.load_scenario('faults/drift.toml').faults), "
        "gb.load_campaign('ci').flights)"
    )
    done = subprocess.run(
        [installed / "python", "-c", script],
        cwd=tmp_path,
        env=own_environment(),
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == ["True", "3", "2"]


@pytest.mark.nightly
@pytest.mark.skipif(compiler() is None, reason="no C compiler")
def test_the_wheel_exports_c_that_passes_its_own_test(installed, tmp_path):
    save_monitor(monitor(), tmp_path / "monitor.json")
    export = [installed / "gtmbench", "export", "monitor.json", "--out", "c"]
    subprocess.run(export, cwd=tmp_path, env=own_environment(), check=True, capture_output=True)
    build = [compiler(), "-std=c99", "-O1", "test_gtm_monitor.c", "-o", "own_test", "-lm"]
    subprocess.run(build, cwd=tmp_path / "c", check=True)
    done = subprocess.run([tmp_path / "c" / "own_test"], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("PASS")


PROJECT = """
import pytest
import gtmbench as gb
from gtmbench.testing import assert_detects, assert_residual


@pytest.fixture(scope="session")
def operator(gtm_record):
    part = gtm_record.between(5, 60)
    return gb.identify(part, inputs=["p", "q", "beta"], outputs=["r"], causal_order=9, noncausal_order=9)


@pytest.mark.parametrize("below", [50, 0.5])
def test_residual(gtm_record, operator, below):
    assert_residual(gtm_record, operator, below=below)


def test_jam():
    def still(record):
        return record.time_s[1:][record["q"][1:] == record["q"][:-1]][:1]

    assert_detects(still, gb.Jam(channel="q", onset_s=100), within_s=0.1)
"""


@pytest.mark.nightly
def test_the_pytest_plugin_works_in_a_project_of_its_own(installed, tmp_path):
    """Nothing but pytest beside it; one test fails, on purpose."""
    (site,) = installed.parent.glob("lib/python*/site-packages")
    link({"pytest", *needed(distribution("pytest"))}, site)
    (tmp_path / "test_gyros.py").write_text(PROJECT)

    def ran(*arguments):
        run = [installed / "python", "-m", "pytest", "-W", "error", "--strict-markers", *arguments]
        environment = {**own_environment(), "CI": "1"}
        return subprocess.run(run, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)

    done = ran()
    (recording,) = (tmp_path / "gtmbench-artefacts").iterdir()
    assert "1 failed, 2 passed in " in done.stdout, done.stdout + done.stderr
    assert "AssertionError: residual of r reached " in done.stdout
    assert f"(allowed: below 0.5 deg/s); recording: gtmbench-artefacts/{recording.name}\n" in done.stdout
    subprocess.run([Path(sys.executable).parent / "rerun", "rrd", "verify", recording], check=True, capture_output=True)
    assert "fixture 'gtm_record' not found" in ran("-p", "no:gtmbench").stdout


def pins(text):
    """Return the version of each name in lines of requirements."""
    lines = [line.partition(";")[0].split("==") for line in text.splitlines() if "==" in line]
    return {canonicalize_name(name.strip()): version.split()[0] for name, version in lines}


@pytest.mark.nightly
def test_the_pinned_versions_resolve():
    """Of wheels only, for all Pythons that the README names at once; uv, as pip takes ten times as long for it."""
    since = "3.11.5"  # what the documentation needs isn't for 3.11.4
    resolve = [find_uv_bin(), "pip", "compile", "--quiet", "--no-header", "--universal", "--python-version", since]
    done = subprocess.run(
        [*resolve, "--extra", "dev", "--only-binary", ":all:", "-c", "constraints.txt", "pyproject.toml"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    resolved, pinned = pins(done.stdout), pins((ROOT / "constraints.txt").read_text())
    assert resolved.items() <= pinned.items(), "what isn't pinned isn't the same tomorrow"
