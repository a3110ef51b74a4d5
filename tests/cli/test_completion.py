"""The shell completes commands: what click offers works for this program, in every shell that it knows."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

COMMAND = Path(sys.executable).parent / "gtmbench"


@pytest.mark.parametrize(("shell", "place"), [("bash", "1"), ("zsh", "1"), ("fish", "mon")])
def test_a_command_is_completed(shell, place):
    def asked(what):
        words = {"_GTMBENCH_COMPLETE": f"{shell}_{what}", "COMP_WORDS": "gtmbench mon", "COMP_CWORD": place}
        done = subprocess.run([COMMAND], env={**os.environ, **words}, capture_output=True, text=True, check=False)
        return done.stdout

    assert "monitor" in asked("complete")
    assert "_GTMBENCH_COMPLETE" in asked("source")
