"""The exported folder stands alone, its own test finds what is wrong, and what can't go on board is refused."""

import json
import re
import shutil
import subprocess
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.errors import InputError
from gtmbench.export.board import board_of
from gtmbench.export.write import FILES
from studies.compiled import STRICT, compiler, missing_tools, run_on_m4
from tests.helpers.monitors import monitor, record
from tests.helpers.night import by_day
from tests.helpers.sealed import resealed

needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")


def own_test(folder, *flags):
    """Compile and run a folder's own test; return how it ended and what it said."""
    command = [compiler(), *STRICT, *flags, "test_gtm_monitor.c", "-o", "own_test", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    ended = subprocess.run([folder / "own_test"], capture_output=True, text=True)
    return ended.returncode, ended.stdout + ended.stderr


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return gb.export_c(monitor(), tmp_path_factory.mktemp("export") / "full").folder


@needs_compiler
@pytest.mark.parametrize("compact", by_day([False, True]))
def test_its_own_test_passes_without_a_warning_under_sanitizers(tmp_path, compact):
    exported = gb.export_c(monitor(), tmp_path / "c", compact=compact)
    code, said = own_test(exported.folder, "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    assert code == 0, said
    assert said.startswith("PASS")


@needs_compiler
@pytest.mark.parametrize("table", by_day(["MARKOV_0", "WHITENERS_2", "TESTS_1", "TOLERANCES", "SUSPICIONS", "OFFSETS"]))
def test_its_own_test_finds_a_mutated_coefficient(folder, tmp_path, table):
    broken = tmp_path / "c"
    shutil.copytree(folder, broken)
    code = (broken / "gtm_monitor.c").read_text()
    found = re.search(rf"\b{table}\[[^=]*= \{{\s*\{{?(-?[\d.e-]+)f", code)
    changed = np.float32(1.001 * float(found[1]) + 1e-6)  # one is 0
    assert changed != np.float32(found[1])
    (broken / "gtm_monitor.c").write_text(f"{code[: found.start(1)]}{changed:.9g}{code[found.end(1) :]}")
    ended, said = own_test(broken, "-O1")
    assert (ended, said) == (1, "FAIL: a coefficient isn't what was exported\n")


@pytest.mark.skipif(shutil.which("clang-tidy") is None, reason="no clang-tidy")
@pytest.mark.parametrize("compact", [False, True])
def test_clang_tidy_finds_nothing_prone_to_bugs(tmp_path, compact):
    exported = gb.export_c(monitor(), tmp_path / "c", compact=compact)
    checks = (
        "-*,bugprone-*,clang-analyzer-*,-bugprone-easily-swappable-parameters,-clang-analyzer-security.insecureAPI.*"
    )
    command = ["clang-tidy", f"--checks={checks}", "--warnings-as-errors=*", "gtm_monitor.c", "--", "-std=c99"]
    ended = subprocess.run(command, cwd=exported.folder, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stdout


def test_the_same_monitor_gives_the_same_bytes_and_its_digest(folder, tmp_path):
    gb.save_monitor(monitor(), tmp_path / "ready.json")
    again = gb.export_c(tmp_path / "ready.json", tmp_path / "again")
    assert sorted(path.name for path in again.folder.iterdir()) == sorted([*FILES, "SHA256SUMS"])
    for name in FILES:
        assert (again.folder / name).read_bytes() == (folder / name).read_bytes()
    assert again.digest == json.loads((tmp_path / "ready.json").read_text())["digest"]
    assert f'GTM_MONITOR_DIGEST "{again.digest}"' in (folder / "gtm_monitor.h").read_text()


def test_what_cannot_go_on_board_is_refused_in_a_line():
    certain = monitor()
    regime = replace(certain, provenance=MappingProxyType({"regime": {"gyros_deg_s": 10.0}}))
    energy = gb.calibrate([record()], bank=gb.load_bank("paper"))
    cautious = gb.calibrate(
        [record()], bank=gb.load_bank("C"), estimator=gb.Bayesian() if hasattr(gb, "Bayesian") else None
    )
    for refused, why in ((regime, "logs"), (energy, "'energy'"), (cautious, "little flight"), (object(), "only banks")):
        if refused is cautious and not cautious.is_cautious:
            continue
        with pytest.raises(InputError, match=why) as told:
            board_of(refused)
        assert "\n" not in str(told.value)
        assert "gtmbench calibrate" in str(told.value)


def alter(document, each, place, value):
    """Put a value where it doesn't belong."""
    figures = document["figures"]
    places = [
        lambda: figures["bank"].__setitem__("title", value),
        lambda: figures.__setitem__("name", value),
        lambda: figures["bank"]["residuals"][0].__setitem__("output", value),
        lambda: figures["bank"]["suspects"].__setitem__(0, value),
        lambda: figures.__setitem__("sample_period_s", value),
        lambda: each["whitener"].__setitem__("deviation", value),
        lambda: each["operator"]["markov"][0][0].__setitem__(0, value),
        lambda: each["tolerance"].__setitem__("high", value),
        lambda: document["provenance"].__setitem__("source", value),
    ]
    places[place % len(places)]()


@pytest.mark.nightly
def test_hostile_files_are_refused_or_harmless(tmp_path):
    """Names that would end a comment or a string, numbers that no float holds, sizes beyond bounds: 200 files."""
    gb.save_monitor(monitor(), tmp_path / "ready.json")
    ready = (tmp_path / "ready.json").read_text()
    draw, refused = np.random.default_rng(1), 0
    nasty = [
        "*/ int x;",
        '"; system("x',
        "a\\\nb",
        "p;",
        "{{ 7*7 }}",
        "\u202e",
        "int",
        "",
        "p" * 5000,
        1e300,
        -1,
        0,
        1e-300,
        10**9,
    ]
    for i in range(200):
        document = json.loads(ready)
        figures = document["figures"]
        value = nasty[int(draw.integers(len(nasty)))]
        each = figures["residuals"][str(draw.choice(["p", "q", "r"]))]
        alter(document, each, i, value)
        path, out = tmp_path / "hostile.json", tmp_path / f"out_{i}"
        path.write_text(json.dumps(resealed(document)))
        try:
            gb.export_c(path, out)
        except InputError:
            refused += 1
            assert not out.exists()
        else:
            code = "".join((out / name).read_text() for name in FILES)
            assert not any(isinstance(value, str) and len(value) > 3 and value in code for value in [value])
            shutil.rmtree(out)
    assert refused > 80


def test_the_command_ends_with_a_line_and_nothing_half_written(cli, tmp_path):
    (tmp_path / "no.json").write_text("{}")
    code, _, err = cli("export", str(tmp_path / "no.json"), "--out", str(tmp_path / "c"))
    assert (code, err.count("\n"), (tmp_path / "c").exists()) == (2, 1, False)


@pytest.mark.skipif(bool(missing_tools()), reason="no tools for a Cortex-M4")
def test_it_passes_on_a_cortex_m4(folder, tmp_path):
    m4 = run_on_m4(folder, board_of(monitor()), tmp_path)
    assert m4.said.startswith("PASS")
    assert m4.instructions.max() < 40_000
