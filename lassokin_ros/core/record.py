"""Records: dataclasses that are not changed after they were made, compared by identity; and their lazy properties.

Type checkers check that they are not changed. `dataclass(frozen=True)` would check it at run time too, with a function
call for each field of each object: 4 % of the tracker's step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

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


class lazy(Generic[T]):
    """Decorator of a property that is computed at the first access and then kept in the object.

    Like functools.cached_property, which has a lock in Python 3.11 and takes three times as long.
    """

    def __init__(self, compute: Callable[[Any], T]) -> None:
        self._compute, self._name, self.__doc__ = compute, compute.__name__, compute.__doc__

    def __get__(self, instance: Any, owner: Any = None) -> T:
        """The value; later accesses find it in the object's __dict__."""
        value = instance.__dict__[self._name] = self._compute(instance)
        return value
