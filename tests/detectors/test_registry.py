"""Detectors by name, by file and by object: what is found, and what is refused, in one line."""

import sys
from importlib.metadata import EntryPoint

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.bank_detector import BankDetector
from gtmbench.detectors.base import FunctionDetector
from gtmbench.detectors.registry import as_detector, detector_names, find_detector, for_data_file
from gtmbench.detectors.windowed_norm import DissertationOperator, NormMonitor
from gtmbench.files.shipped import shipped_banks
from tests.helpers.monitors import monitor, record

OWN = """
from pathlib import Path

import gtmbench as gb
from gtmbench.detectors.windowed_norm import DissertationOperator

def quiet(record):
    return []

ready = gb.load_monitor(Path(gb.__file__).with_name("baselines") / "bank-C.json")
recipe = DissertationOperator(name="mine", causal_order=4, noncausal_order=3, window=50)
bank = gb.load_bank("B")
number = 3

class Recipe(DissertationOperator):
    pass

class Needs:
    def __init__(self, something):
        pass

class Half:
    name = "half"
    def calibrate(self, records):
        pass

class Watcher:
    name, channels = "watcher", ("p",)
    def watch(self, record):
        pass
"""


@pytest.fixture
def own(tmp_path):
    """Return a file of somebody's own."""
    path = tmp_path / "own.py"
    path.write_text(OWN)
    return path


@pytest.fixture
def packages(monkeypatch):
    """Register a detector as an installed package does."""
    points = [
        EntryPoint(name="theirs", value="tests.detectors.test_registry:Theirs", group="gtmbench.detectors"),
        EntryPoint(name="broken", value="a_package_that_isnt_there:Detector", group="gtmbench.detectors"),
        EntryPoint(name="C", value="a_package_that_isnt_there:Detector", group="gtmbench.detectors"),
    ]
    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: [p for p in points if p.group == group])


class Theirs(FunctionDetector):
    """A detector of an installed package."""

    def __init__(self):
        super().__init__(lambda record: record.time_s[:1], name="theirs")


@pytest.mark.parametrize("name", shipped_banks())
def test_every_bank_is_found_by_its_name(name):
    detector = find_detector(name)
    assert detector == BankDetector(bank=gb.load_bank(name))
    assert for_data_file(name) == detector


def test_the_dissertations_is_found_by_its_name():
    assert find_detector("dissertation") == DissertationOperator()


def test_files_are_found_by_their_suffix(tmp_path):
    (tmp_path / "mine.toml").write_text(shipped_banks()["paper"].read_text())
    assert find_detector(tmp_path / "mine.toml").name == "mine"
    gb.save_monitor(monitor(), tmp_path / "m.json")
    assert find_detector(str(tmp_path / "m.json")).bank == monitor().bank
    assert for_data_file(tmp_path / "m.json").bank == monitor().bank


@pytest.mark.parametrize(
    ("name", "kind"), [("quiet", FunctionDetector), ("recipe", DissertationOperator), ("bank", BankDetector)]
)
def test_an_object_of_a_file_is_found(name, kind, own):
    assert type(find_detector(f"{own}:{name}")) is kind


def test_a_class_is_made(own):
    assert find_detector(f"{own}:Recipe").outputs == ("r",)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("number", "'number' is a int, no detector; give a Detector, a Monitor, a Bank or a function"),
        ("Needs", "Needs can't be made without arguments: .*something"),
        ("Half", "a Detector has name, channels, calibrate; 'Half' lacks channels"),
        ("Watcher", "'Watcher' lacks suspects, .*provenance, stream; gtmbench.BaseMonitor gives what may be left out"),
    ],
)
def test_what_is_no_detector_is_refused(name, said, own):
    with pytest.raises(gb.InputError, match=said):
        find_detector(f"{own}:{name}")


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("D", "no detector is called 'D'; there are dissertation, auto, B, C"),
        ("nowhere.toml", "no bank 'nowhere"),
        ("nowhere.json", "no such file"),
        ("own.py", "say which object in it is the detector: own.py:OBJECT"),
        ("nowhere.py:Mine", "no file nowhere.py"),
    ],
)
def test_what_isnt_there_is_refused_in_one_line(source, said):
    with pytest.raises(gb.InputError, match=said) as refused:
        find_detector(source)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("source", ["own.py:recipe", "os:getcwd", "some.package:Recipe.inner"])
def test_a_data_file_imports_no_python(source):
    with pytest.raises(gb.InputError, match=r"a data file doesn't import Python; give --detector FILE.py:OBJECT"):
        for_data_file(source)


def test_the_colon_of_a_drive_is_no_object():
    with pytest.raises(gb.InputError, match="no bank 'C:"):
        for_data_file("C:\\bank.toml")


@pytest.mark.usefixtures("packages")
def test_installed_ones_are_listed_without_importing_and_found_by_name():
    assert detector_names()["broken"] == "installed: a_package_that_isnt_there:Detector"
    assert detector_names()["C"] == gb.load_bank("C").title
    assert "a_package_that_isnt_there" not in sys.modules
    assert find_detector("theirs").name == for_data_file("theirs").name == "theirs"
    with pytest.raises(gb.InputError, match=r"a_package_that_isnt_there"):
        find_detector("broken")


@pytest.mark.usefixtures("packages")
def test_a_monitor_of_an_installed_one_is_read(tmp_path):
    path = tmp_path / "m.json"
    gb.save_monitor(Theirs().calibrate(), path)
    assert [alarm.time_s for alarm in gb.load_monitor(path).watch(record(100)).alarms] == [0.0]


def test_figures_of_ones_own_need_their_recipe(own, tmp_path):
    recipe, path = find_detector(f"{own}:recipe"), tmp_path / "m.json"
    gb.save_monitor(recipe.calibrate([record(seed=1), record(seed=2)]), path)
    monitor = find_detector(f"{own}:recipe@{path}")
    assert isinstance(monitor, NormMonitor)
    assert monitor.name == "mine"
    gb.save_monitor(find_detector(f"{own}:quiet").calibrate(), path)
    with pytest.raises(gb.InputError, match="a monitor of 'quiet', which isn't installed here"):
        find_detector(path)
    assert find_detector(f"{own}:quiet@{path}").watch(record(100)).alarms == ()
    with pytest.raises(gb.InputError, match="a monitor of 'quiet', which 'mine' can't restore"):
        find_detector(f"{own}:recipe@{path}")


def test_a_monitor_is_calibrated_already(own, tmp_path):
    gb.save_monitor(monitor(), tmp_path / "m.json")
    with pytest.raises(gb.InputError, match=r"is a monitor, calibrated already; leave @.*m\.json out"):
        find_detector(f"{own}:ready@{tmp_path / 'm.json'}")


def test_every_object_that_can_serve_is_adapted():
    recipe, calibrated = DissertationOperator(), monitor()
    assert as_detector(recipe) is recipe
    assert as_detector(calibrated) is calibrated
    assert as_detector(gb.load_bank("C")) == as_detector("C")
    assert as_detector(DissertationOperator) == recipe
    assert as_detector(lambda _: np.zeros(0)).calibrate([]).watch(record(100)).alarms == ()
