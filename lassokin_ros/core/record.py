"""Records: dataclasses that are not changed after they were made, compared by identity.

Type checkers check it. `dataclass(frozen=True)`, as of `Observation` and `Estimate`, which users make and keep, checks
it at run time too, with a function call for each field: 4 % of the tracker's step for all records.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from typing_extensions import dataclass_transform
else:

    def dataclass_transform(**_: Any) -> Any:
        """Nothing at run time."""
        return lambda decorator: decorator


T = TypeVar("T")


@dataclass_transform(eq_default=False, frozen_default=True)
def record(kind: type[T]) -> type[T]:
    """Make a class with annotated fields a dataclass, see the module's docstring."""
    return dataclass(eq=False)(kind)
