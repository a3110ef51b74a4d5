"""The package's front door: everything public is there, and nothing heavy before it is asked for."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import gtmbench as gb
from gtmbench import api
from tests.release import EXTRAS


def fresh(code):
    """Return what a fresh interpreter prints."""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return run.stdout.strip()


def test_every_public_name_is_the_apis():
    assert set(api.__all__) <= set(dir(gb))
    for name in api.__all__:
        assert getattr(gb, name) is getattr(api, name), name


def test_a_name_that_isnt_there_is_an_attribute_error():
    with pytest.raises(AttributeError, match="module 'gtmbench' has no attribute 'flie'"):
        _ = gb.flie
    assert fresh("from gtmbench import *; print(Jam.kind)") == "jam"


def test_what_a_test_puts_in_a_names_place_stays_there(monkeypatch):
    monkeypatch.setattr(gb, "fly", None)
    assert not hasattr(gb, "flie")
    assert gb.fly is None


def test_every_extra_of_users_is_tried_before_a_release():
    described = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    assert set(EXTRAS) == set(described["optional-dependencies"]) - {"bench", "dev", "docs", "release"}
