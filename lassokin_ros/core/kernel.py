"""The optional compiled kernel: the loops of a tracked frame that gain most in C, see `_kernel.c`.

`setup.py` builds it if there is a C compiler. Without it, or with `LASSOKIN_KERNEL=0` in the environment, the functions
are None, and the Python code beside each call does the same. Each function writes its results into the last arrays that
it is given, and returns True; or returns False if it does not treat a case, and Python then computes it.
"""

from __future__ import annotations

import os
import warnings
from types import ModuleType

SWITCH = "LASSOKIN_KERNEL"
"""Environment variable: 0 switches the kernel off."""
FUNCTIONS = "pose", "linearise", "predicted", "follow", "features"


def _load() -> ModuleType | None:
    try:
        from lassokin_ros.core import _kernel  # type: ignore[attr-defined]
    except ImportError:
        return None
    if set(FUNCTIONS) != {name for name in vars(_kernel) if not name.startswith("_")}:
        rebuild = "build it again with `python setup.py build_ext --inplace`"
        warnings.warn(f"the compiled kernel is of another revision, and is not used: {rebuild}", stacklevel=1)
        return None
    return _kernel  # type: ignore[no-any-return]


compiled = _load()
active = compiled is not None and os.environ.get(SWITCH) != "0"
pose, linearise, predicted, follow, features = (getattr(compiled, name) if active else None for name in FUNCTIONS)
