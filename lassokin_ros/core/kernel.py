"""Compiled code: the optional kernel, the inner loops of a tracked frame in C (`_kernel.c`); and scipy's LAPACK alone.

`setup.py` builds the kernel if there is a C compiler. Without it, or with `LASSOKIN_KERNEL=0` in the environment, the
Python code beside each call does the same. Each function writes its results into the last arrays that it is given, and
returns True; or returns False if it does not treat a case, and Python then computes it.

`import scipy.linalg` takes as long as all other imports of the core together, and 24 MB, for modules that are not used
here (numpy.testing, numpy.f2py). Therefore its LAPACK module is loaded alone; its functions are the same.
"""

from __future__ import annotations

import importlib
import os
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import scipy

SWITCH = "LASSOKIN_KERNEL"
"""Environment variable: 0 switches the kernel off."""

compiled: ModuleType | None
try:
    from lassokin_ros.core import _kernel as compiled  # type: ignore[attr-defined, no-redef]
except ImportError:
    compiled = None


FUNCTIONS = "pose retract linearise cost eliminate predicted condensed follow features activate".split()
"""Of the kernel; Python does the same without it."""


class Kernel:
    """The compiled functions. `active`: whether they are used."""

    def __init__(self) -> None:
        vars(self).update({} if compiled is None else {name: getattr(compiled, name) for name in FUNCTIONS})
        self.active = compiled is not None and os.environ.get(SWITCH) != "0"

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Callable[..., bool]: ...

    @contextmanager
    def switched(self, active: bool) -> Iterator[None]:
        """Use the kernel, or the Python code, within a block. Without a compiled kernel it is always Python."""
        before, self.active = self.active, active and compiled is not None
        try:
            yield
        finally:
            self.active = before


if compiled is not None and not set(FUNCTIONS) <= vars(compiled).keys():
    rebuild = "build it again with `python setup.py build_ext --inplace`"
    warnings.warn(f"the compiled kernel is of another revision, and is not used: {rebuild}", stacklevel=1)
    compiled = None
kernel = Kernel()


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
