"""Python of the user's own is imported where the user names it, and nowhere else."""

import os
import pickle
import subprocess
import sys
from pathlib import Path

import pytest

from gtmbench.errors import InputError
from gtmbench.imports import load_module, load_object

OWN = """
from dataclasses import dataclass

@dataclass(frozen=True)
class Own:
    gain: float = 2.0

own = Own()
"""


@pytest.fixture
def own(tmp_path):
    path = tmp_path / "own.py"
    path.write_text(OWN)
    return path


def test_an_object_of_a_file_is_the_same_each_time_and_can_be_pickled(own):
    first, again = (load_object(f"{own}:own") for _ in range(2))
    assert first is again
    assert first.gain == 2.0
    assert pickle.loads(pickle.dumps(first)) == first
    assert load_module(own) is load_module(str(own))


def test_a_file_takes_no_modules_name_and_its_folder_isnt_searched(tmp_path):
    (tmp_path / "json.py").write_text("import beside")
    (tmp_path / "beside.py").write_text("")
    path = list(sys.path)
    with pytest.raises(
        InputError, match=r"json\.py can't be imported: no module 'beside'; install it, or put its folder on PYTHONPATH"
    ):
        load_module(tmp_path / "json.py")
    import json

    assert json.loads("1") == 1
    assert sys.path == path
    assert not [name for name in sys.modules if name.startswith("_gtmbench_json")]


def test_files_of_one_name_are_two_modules(tmp_path):
    for folder, value in (("a", 1), ("b", 2)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "own.py").write_text(f"value = {value}")
    assert [load_object(f"{tmp_path / folder / 'own.py'}:value") for folder in "ab"] == [1, 2]


@pytest.mark.parametrize("safe", [[], ["-P"]], ids=["", "safe path"])
@pytest.mark.parametrize(
    "how", [["-c", "import probe_"], ["-m", "probe"], ["-m", "timeit", "-n1", "-r1", "import probe_"]]
)
def test_the_current_folder_is_searched_only_where_the_user_says_so(tmp_path, how, safe):
    (tmp_path / "evil.py").write_text("print('imported')\nOBJECT = 1")
    probe = (
        "from gtmbench.imports import load_object\nfrom gtmbench.errors import InputError\n"
        "try:\n    load_object('evil:OBJECT')\nexcept InputError as error:\n    print(error)\n"
    )
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    for folder, name in ((tmp_path, "probe.py"), (elsewhere, "probe_.py"), (elsewhere, "probe.py")):
        (folder / name).write_text(probe)
    package = str(Path(load_module("gtmbench.imports").__file__).parents[1])
    for explicit, said in (([], "no module 'evil'; install it, or give its file"), ([str(tmp_path)], "imported")):
        told = subprocess.run(
            [sys.executable, *safe, *how],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": os.pathsep.join([package, str(elsewhere), *explicit])},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        assert said in told
        assert ("imported\n" in told) == bool(explicit)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("own.py", r"'own\.py' names no object; give FILE\.py:OBJECT or package\.module:OBJECT"),
        (":own", "names no object"),
        ("json:", "names no object"),
        ("json:a.b", "names no object"),
        ("no/such.py:own", r"no file no/such\.py; give FILE\.py or a module's dotted name"),
        ("no/such:own", "'no/such' names no module; give"),
        ("gtmbench.no_such:own", r"gtmbench\.no_such can't be imported: no module 'gtmbench\.no_such'; install it, or"),
        ("gtmbench.version:own", r"gtmbench\.version has no 'own'; it holds "),
    ],
)
def test_what_cant_be_meant_is_refused_in_one_line(source, message):
    with pytest.raises(InputError, match=message) as refused:
        load_object(source)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 +", "can't be imported: SyntaxError: "),
        ("raise ValueError('two\\nlines')", "can't be imported: ValueError: two lines"),
        ("import sys; sys.exit(3)", "can't be imported: SystemExit: 3"),
        ("from gtmbench.errors import InputError\nraise InputError('own words')", r"bad\.py: own words"),
    ],
)
def test_a_file_that_fails_says_with_what_and_can_be_mended(tmp_path, text, message):
    bad = tmp_path / "bad.py"
    bad.write_text(text)
    with pytest.raises(InputError, match=message) as refused:
        load_module(bad)
    assert "\n" not in str(refused.value)
    bad.write_text("value = 'now it is another length'")
    assert load_module(bad).value.startswith("now")
