"""The packages of the extra ``theory``, which not every user of the rest has."""

from __future__ import annotations

import importlib
from types import ModuleType

from gtmbench.errors import InputError


def extra(package: str, what: str) -> ModuleType:
    """Import a package of the extra for `what`, in the plural; or say in one line how to get it.

    >>> extra("sympy", "exact operators").__name__
    'sympy'
    """
    try:
        return importlib.import_module(package)
    except ImportError as error:
        raise InputError(f"{what} need the package {package}; pip install 'gtmbench[theory]'") from error
