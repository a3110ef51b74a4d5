"""Modules that may not be there: the user's own, imported because the user named them, and those of our extras.

Nothing else in this package imports what a text names. A scenario, a monitor's file and every other data file can only
choose among what is built in, what installed packages announce by entry points (imported when it is chosen) and what
has been imported by these functions before.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from hashlib import sha256
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

from gtmbench.checks import meant, one_line, shown
from gtmbench.errors import InputError
from gtmbench.files.writing import is_file

# groups of entry points
FAULTS = "gtmbench.faults"  # KIND = "package.module:CLASS"
DETECTORS = "gtmbench.detectors"  # NAME = "package.module:OBJECT"
_PRIVATE = "_gtmbench_"  # how the names of modules begin that come from files
_HOW = "give FILE.py or a module's dotted name"

_brought: dict[str, ModuleType] = {}  # what the user has had imported: by the name of its file, or its dotted one


def load_module(source: str | Path) -> ModuleType:
    """Import a module by its file's path, ``FILE.py``, or by its dotted name, ``package.module``.

    A file gets a private name made from its path, so that it never stands in the way of an installed module and its
    folder isn't searched for others; asked for again, it is the same module. A name is looked for where Python looks,
    but not in the current folder: ``python -m gtmbench`` would search that first, where a downloaded log may lie beside
    a ``numpy.py``. Where the user has put that folder on the path (``PYTHONPATH``, an editable install) it is searched.

    >>> load_module("json.decoder").__name__
    'json.decoder'
    """
    text = str(source)
    if isinstance(source, Path) or text.endswith(".py"):
        module = _of_file(Path(source))
        _brought[Path(source).name] = module
        return module
    if not all(part.isidentifier() for part in text.split(".")):
        raise InputError(f"{shown(text)} names no module; {_HOW}")
    with _without_current_folder(), _import_errors(text):
        _brought[text] = import_module(text)
    return _brought[text]


def brought_object(source: str) -> object:
    """Return an object that a data file names, ``FILE.py:OBJECT``, of a module that `load_module` has imported before.

    A file is found by its name alone, wherever it lies: who imports it decides which one is meant.

    >>> brought_object("elsewhere.py:Pilot")
    Traceback (most recent call last):
    gtmbench.errors.InputError: 'elsewhere.py:Pilot' isn't imported, and a file of data imports nothing by itself; ...
    """
    module_name, colon, name = source.rpartition(":")
    if not colon or not module_name or not name.isidentifier():
        raise InputError(f"{shown(source)} names no object; give FILE.py:OBJECT or package.module:OBJECT")
    module = _brought.get(Path(module_name).name if module_name.endswith(".py") else module_name)
    if module is None:
        how = f"--import {module_name}, in Python gtmbench.imports.load_module({module_name!r})"
        raise InputError(f"{shown(source)} isn't imported, and a file of data imports nothing by itself; {how}")
    return _object_of(module, module_name, name)


def files_of(objects: Iterable[object]) -> tuple[str, ...]:
    """Return the files of `load_module`'s that hold some objects' classes, or functions, for another process to import.

    >>> files_of([1, print])
    ()
    """
    names = {getattr(one, "__module__", None) or type(one).__module__ for one in objects}
    files = (sys.modules[name].__file__ for name in names if name.startswith(_PRIVATE) and name in sys.modules)
    return tuple(sorted(file for file in files if file))


def digests_of(files: Iterable[str]) -> dict[str, str]:
    """Return digests of such files by their names: what a result hangs on that stands on them."""
    return {Path(file).name: sha256(Path(file).read_bytes()).hexdigest()[:16] for file in files}


def load_files(files: Iterable[str]) -> None:
    """Import files of the user's own: pickles name their classes."""
    for file in files:
        load_module(file)


def load_object(source: str) -> object:
    """Import an object: ``FILE.py:OBJECT`` or ``package.module:OBJECT``, split at the last colon.

    >>> load_object("json:JSONDecoder").__name__
    'JSONDecoder'
    """
    module_name, colon, name = source.rpartition(":")
    if not colon or not module_name or not name.isidentifier():
        raise InputError(f"{shown(source)} names no object; give FILE.py:OBJECT or package.module:OBJECT")
    return _object_of(load_module(module_name), module_name, name)


def _object_of(module: ModuleType, module_name: str, name: str) -> object:
    try:
        return getattr(module, name)
    except AttributeError as error:
        public = [own for own in vars(module) if not own.startswith("_")]
        there = f"{', '.join(public) or 'nothing'}{meant(name, public)}"
        raise InputError(one_line(f"{module_name} has no '{name}'; it holds {there}")) from error


def installed(group: str) -> dict[str, str]:
    """Return what installed packages announce under a group of entry points, by name; nothing is imported.

    The values are sources as `load_object` takes them; where packages don't agree, both of them.

    >>> installed("gtmbench.nothing")
    {}
    """
    from importlib.metadata import entry_points

    sources: dict[str, set[str]] = {}
    with _without_current_folder():
        for point in entry_points(group=group):
            sources.setdefault(point.name, set()).add(f"{point.module}:{point.attr}")
    return {name: " or ".join(sorted(announced)) for name, announced in sorted(sources.items())}


def load_installed(group: str, name: str) -> object:
    """Import what an installed package announces under a group and a name.

    Raises InputError where none does, several do, or importing it fails.
    """
    known = installed(group)
    if name not in known:
        raise InputError(f"no installed package announces {shown(name)} under {group}")
    if " or " in known[name]:
        raise InputError(f"'{name}' of {group} is {known[name]}: two packages announce it; uninstall one of them")
    return load_object(known[name])


def load_extra(module: str, extra: str, needs: str) -> ModuleType:
    """Import a module of a package that only an extra of gtmbench installs; `needs` begins the line that says so.

    Raises InputError where it isn't installed, with how to get it.

    >>> load_extra("json.decoder", "theory", "exact operators need").__name__
    'json.decoder'
    """
    try:
        return import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise InputError(f"{needs} the package {package}; pip install 'gtmbench[{extra}]'") from error


def _of_file(path: Path) -> ModuleType:
    if not is_file(path):
        raise InputError(f"no file {path}; {_HOW}")
    path = path.resolve()
    # its own place in sys.modules: dataclasses and pickle look a class's module up there
    stem = "".join(letter if letter.isalnum() else "_" for letter in path.stem)
    name = f"{_PRIVATE}{stem}_{sha256(bytes(path)).hexdigest()[:12]}"
    if name in sys.modules:
        return sys.modules[name]
    spec = spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise InputError(f"{path} isn't Python; {_HOW}")
    module = sys.modules[name] = module_from_spec(spec)
    try:
        with _without_current_folder(), _import_errors(str(path)):
            spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


@contextmanager
def _import_errors(source: str) -> Iterator[None]:
    """Turn whatever an import raises into one line."""
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name is not None and f"{source}.".startswith(f"{error.name}."):
            why = "install it, or give its file, FILE.py (the current folder isn't searched)"
        else:  # another one, which the module needs
            why = "install it, or put its folder on PYTHONPATH (a file's own folder isn't searched)"
        raise InputError(one_line(f"{source} can't be imported: no module '{error.name}'; {why}")) from error
    except InputError as error:
        raise InputError(one_line(f"{source}: {error}")) from error
    except (Exception, SystemExit) as error:  # a script's sys.exit, too
        raise InputError(one_line(f"{source} can't be imported: {type(error).__name__}: {error}")) from error


@contextmanager
def _without_current_folder() -> Iterator[None]:
    """Take from Python's path what Python puts there for the current folder: '' or '.', or that folder in front.

    What the user puts there (``PYTHONPATH``, an editable install) is absolute, and stands further back.
    """
    before = list(sys.path)
    kept = [entry for entry in before if Path(entry).is_absolute()]
    if kept[:1] == [str(Path.cwd())] and not sys.flags.safe_path:
        del kept[0]
    sys.path[:] = kept
    try:
        yield
    finally:
        if sys.path == kept:  # an import may change the path, and then it stays so
            sys.path[:] = before
