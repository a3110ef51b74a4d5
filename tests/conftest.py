"""Hypothesis draws the same examples in every run, and rerun asks the network nothing."""

import os

import pytest
from hypothesis import settings

from gtmbench.cli.app import main
from gtmbench.method.regression import triangle
from gtmbench.shipped import share

os.environ.setdefault("CI", "1")

settings.register_profile("gtmbench", derandomize=True, deadline=None)
settings.load_profile("gtmbench")


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
