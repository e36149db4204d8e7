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

SWITCH = "LASSOKIN_KERNEL"
"""Environment variable: 0 switches the kernel off."""

compiled: ModuleType | None
try:
    from lassokin_ros.core import _kernel as compiled  # type: ignore[attr-defined, no-redef]
except ImportError:
    compiled = None


class Kernel:
    """The compiled functions. `active`: whether they are used."""

    pose: Callable[..., bool]
    posture: Callable[..., bool]
    retract: Callable[..., bool]
    twists: Callable[..., bool]
    point_columns: Callable[..., bool]
    linearise: Callable[..., bool]
    cost: Callable[..., bool]
    smooth: Callable[..., bool]
    eliminate: Callable[..., bool]
    predicted: Callable[..., bool]
    condensed: Callable[..., bool]
    certify: Callable[..., bool]
    follow: Callable[..., bool]
    sampled: Callable[..., bool]
    features: Callable[..., bool]
    activate: Callable[..., bool]
    decode: Callable[..., bool]

    def __init__(self) -> None:
        self.active = False
        if compiled is not None:
            for name in Kernel.__annotations__:
                setattr(self, name, getattr(compiled, name))
            self.active = os.environ.get(SWITCH) != "0"

    @contextmanager
    def switched(self, active: bool) -> Iterator[None]:
        """Use the kernel, or the Python code, within a block. Without a compiled kernel it is always Python."""
        before, self.active = self.active, active and compiled is not None
        try:
            yield
        finally:
            self.active = before


if compiled is not None and not Kernel.__annotations__.keys() <= vars(compiled).keys():
    rebuild = "build it again with `python setup.py build_ext --inplace`"
    warnings.warn(f"the compiled kernel is of another revision, and is not used: {rebuild}", stacklevel=1)
    compiled = None
kernel = Kernel()
