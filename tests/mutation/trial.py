"""One mutant's tests, in this process: ``python -m tests.mutation.trial FILE SOURCE TESTS NIGHT``."""

from __future__ import annotations

import importlib.util
import sys
from importlib.machinery import ModuleSpec, SourceFileLoader
from pathlib import Path
from types import CodeType

import pytest


class Changed(SourceFileLoader):
    """Imports one module from another text than its file's."""

    def __init__(self, file: Path, text: str) -> None:
        module = ".".join(file.with_suffix("").parts).removesuffix(".__init__")
        super().__init__(module, str(file.resolve()))
        self.text = text

    def find_spec(self, name: str, *_: object) -> ModuleSpec | None:
        """Return where the one module comes from."""
        return importlib.util.spec_from_file_location(name, self.path, loader=self) if name == self.name else None

    def get_code(self, fullname: str) -> CodeType:
        """Compile the other text, whatever is kept of the file's."""
        return compile(self.text, self.path, "exec")


def main(file: str, source: str, tests: str, night: str) -> int:
    """Run the tests and return pytest's exit code."""
    sys.meta_path.insert(0, Changed(Path(file), Path(source).read_text()))
    # pytest would import what ships a plugin by itself, to rewrite its asserts, and from the file
    told = ["-x", "-q", "--assert=plain", "-p", "no:cacheprovider", *(["-m", ""] if night == "1" else [])]
    return int(pytest.main([*told, *Path(tests).read_text().splitlines()]))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
