"""Records: dataclasses that are not changed after they were made, compared by identity.

Type checkers check that they are not changed. `dataclass(frozen=True)` would check it at run time too, with a function
call for each field of each object: 4 % of the tracker's step. `Observation` and `Estimate`, which users make and keep,
are frozen.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from typing_extensions import dataclass_transform
else:

    def dataclass_transform(**_: Any) -> Any:
        """Describe a decorator to type checkers; nothing at run time."""
        return lambda decorator: decorator


T = TypeVar("T")


@dataclass_transform(eq_default=False, frozen_default=True)
def record(kind: type[T]) -> type[T]:
    """Make a class with annotated fields a dataclass, see the module's docstring."""
    return dataclass(eq=False)(kind)
