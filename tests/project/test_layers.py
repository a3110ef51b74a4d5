"""The architecture holds: the method never sees the simulator, data flows one way, no machine leaks into a file."""

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_import_contracts_are_kept():
    linter = Path(sys.executable).parent / "lint-imports"
    searched = {**os.environ, "PYTHONPATH": str(ROOT / "experiments")}
    run = subprocess.run([linter, "--no-cache"], cwd=ROOT, env=searched, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout


def test_no_file_names_a_registry_or_a_path_of_a_machine():
    tracked = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    assert "uv.lock" not in tracked
    forbidden = re.compile(r"https?://[^\s)\"'>]*(?:pypi|pythonhosted|/simple/|download)|/(?:root|home|work)/\w")
    for name in tracked:
        path = ROOT / name
        if path.suffix in {".py", ".toml", ".md", ".txt", ".cff", ".yaml", ".xml", ""} and path.is_file():
            found = forbidden.search(path.read_text(errors="ignore"))
            assert found is None or name == "tests/project/test_layers.py", f"{name}: {found and found[0]}"
