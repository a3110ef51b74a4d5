"""The built wheel, alone: installed into a fresh environment, run in an empty directory."""

import json
import os
import subprocess
import sys
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Return the built wheel."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(folder), str(ROOT)]
    subprocess.run(build, check=True, timeout=300)
    (built,) = folder.glob("gtmbench-*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """Return the commands' folder of a fresh environment that holds the wheel and nothing else of ours."""
    folder = tmp_path_factory.mktemp("alone")
    venv.create(folder / "fresh", with_pip=True)
    commands = folder / "fresh" / "bin"
    install = [commands / "python", "-m", "pip", "install", "--quiet", "-c", ROOT / "constraints.txt", wheel]
    subprocess.run(install, check=True, timeout=600)
    return commands


def own_environment():
    """Return the environment without what points to another Python's modules."""
    return {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}


def test_the_wheel_runs_the_main_job_in_an_empty_directory(installed, tmp_path):
    run = [installed / "gtmbench", "run", "--json"]
    done = subprocess.run(
        run, cwd=tmp_path, env=own_environment(), capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert [trial["detected"] for trial in found["trials"]] == [True] * 15
    assert {"results.json", "trials.csv", "study.rrd", "markov.png"} <= {
        path.name for path in (tmp_path / "study").iterdir()
    }
    assert {path.name for path in tmp_path.iterdir()} == {"study"}


def test_the_wheel_brings_its_data_and_the_name_of_a_shipped_scenario_works_anywhere(installed, tmp_path):
    script = (
        "import gtmbench as gb; from gtmbench.files import share;"
        "print('_share' in str(share()), len(gb.run('faults/drift.toml')))"
    )
    done = subprocess.run(
        [installed / "python", "-c", script],
        cwd=tmp_path,
        env=own_environment(),
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == ["True", "3"]


@pytest.mark.parametrize("python", ["3.11", "3.12", "3.13"])
def test_the_pinned_versions_resolve(wheel, tmp_path, python):
    """Pip resolves for a Python that needn't be here, from wheels alone, and installs nothing."""
    resolve = [sys.executable, "-m", "pip", "install", "--quiet", "--dry-run", "--ignore-installed"]
    target = ["--target", tmp_path, "--python-version", python, "--only-binary=:all:"]
    wanted = ["-c", ROOT / "constraints.txt", f"gtmbench[dev] @ {wheel.as_uri()}"]
    done = subprocess.run([*resolve, *target, *wanted], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
