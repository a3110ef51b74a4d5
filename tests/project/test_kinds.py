"""What other files say of the kinds of faults follows from their classes; a new class alone is a new kind."""

import shutil
import subprocess
import sys

import pytest

from gtmbench.faults.registry import FAULTS, WORDS
from tests.project.kinds import ROOT, wanted


def test_other_files_say_of_the_kinds_what_their_classes_do():
    differ = [str(path.relative_to(ROOT)) for path, text in wanted() if path.read_text(encoding="utf-8") != text]
    assert differ == [], "run `make kinds`"


NEW = '''"""A kind of a file of its own."""

from dataclasses import dataclass
from typing import ClassVar

from gtmbench.faults.fault import Formula
from gtmbench.faults.parameter import severity
from gtmbench.faults.shape import Shape, Typical


@dataclass(frozen=True, kw_only=True)
class Halving(Formula):
    """Each second the signal is half as large as a second before: y 2^-rate (t - onset)."""

    kind: ClassVar[str] = "halving"
    shape: ClassVar = Shape(how="search", family="multiplicative", parameter="rate", low=0.01, high=10.0)
    typical: ClassVar = Typical(shown={"rate": 0.2}, gyro=(0.01, 0.1))
    rate: float = severity(unit="1/s", low=0.0)

    def formula(self, now, elapsed_s, sample_period_s):
        return now[0] * 2.0 ** (-self.rate * elapsed_s)
'''


def test_a_new_kind_is_one_file(tmp_path):
    for name in ("gtmbench", "tests/project", "faults", "docs/reference", "docs/explanation"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__", "*.png"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    (tmp_path / "gtmbench/faults/kinds/halving.py").write_text(NEW)
    written = subprocess.run(
        [sys.executable, "-m", "tests.project.kinds"], cwd=tmp_path, capture_output=True, text=True, check=True
    ).stdout.split()
    assert {"faults/halving.toml", "gtmbench/api.py"} <= {*written}
    assert "Halving" in (tmp_path / "gtmbench/api.py").read_text()
    assert "| `halving` |" in (tmp_path / "docs/reference/faults.md").read_text()


@pytest.mark.parametrize("word", WORDS)
def test_a_word_of_px4s_is_a_kind_with_parameters_that_it_has(word):
    meant = WORDS[word]
    names = {item.name for item in FAULTS[meant.kind].parameters()} | {"intermittent"}
    assert set(meant.parameters) <= names
