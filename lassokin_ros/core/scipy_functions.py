"""Compiled functions of scipy without the packages around them.

`import scipy.linalg` takes as long as all other imports of the core together, and 24 MB, for modules that are not used
here (numpy.testing, numpy.f2py). Therefore its LAPACK module is loaded alone; its functions are the same.
"""

from __future__ import annotations

import importlib
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import scipy


def compiled_module(package: str, name: str, public: str) -> Any:
    """The compiled module `name` of a package of scipy; the module `public` of a scipy without such a file."""
    folder = Path(scipy.__file__).parent / package
    for file in (folder / f"{name}{suffix}" for suffix in EXTENSION_SUFFIXES):
        spec = spec_from_file_location(f"scipy.{package}.{name}", file) if file.is_file() else None
        if spec is not None and spec.loader is not None:
            module = module_from_spec(spec)
            spec.loader.exec_module(module)
            return module
    return importlib.import_module(f"scipy.{public}")


lapack = compiled_module("linalg", "_flapack", "linalg.lapack")
"""As `scipy.linalg.lapack`."""
