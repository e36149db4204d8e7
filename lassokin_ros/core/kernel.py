"""The optional compiled kernel: the inner loops of a tracked frame in C, see `_kernel.c`.

`setup.py` builds it if there is a C compiler. Without it, or with `LASSOKIN_KERNEL=0` in the environment, the Python
code beside each call does the same. Each function of the kernel writes its results into the last arrays that it is
given, and returns True; or returns False if it does not treat a case, and Python then computes it.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import TYPE_CHECKING

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
