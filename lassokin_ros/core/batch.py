"""Several people's trackers side by side, each at its own frame: what they all have to compute is computed at once.

numpy takes hardly longer for the arrays of ten people than for one person's. So a tracker's step is a generator: where
something heavy comes up it hands the `Work` out and goes on with what came of it. Of several people's, that of one kind
is done in one go, by a part like theirs whose arrays have a first axis of people.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from copy import copy
from typing import Any, NamedTuple, TypeVar

import numpy as np

T = TypeVar("T")


class BatchedCall(NamedTuple):
    """A method of a part of a tracker, marked `shared`, to be called with these arguments, all made of arrays."""

    part: Any
    method: str
    arguments: tuple[Any, ...]

    def done(self) -> Any:
        """What comes of it."""
        return getattr(self.part, self.method)(*self.arguments)


Steps = Generator[BatchedCall, Any, T]
"""What `alone` and `run_batched` run, to a T."""


def shared(takes: Sequence[str], gives: Sequence[str]) -> Callable[[T], T]:
    """Mark a method that does several people's work at once, where arrays have one more axis in front.

    Its class has a static method `together(several)`: a copy with what else it needs of several that are alike. takes,
    gives: the attributes that it reads and leaves behind, which each person has.
    """

    def mark(method: T) -> T:
        method.takes, method.gives = takes, gives  # type: ignore[attr-defined]
        return method

    return mark


def run_single(steps: Steps[T]) -> T:
    """One person's, done as it comes."""
    try:
        work = next(steps)
        while True:
            work = steps.send(work.done())
    except StopIteration as end:
        return end.value  # type: ignore[no-any-return]


def run_batched(several: Sequence[Steps[T]]) -> list[T]:
    """Everybody's, in their order: who comes to another kind of work waits for those who still have the one before.

    An error in one of them, the first, is raised when all the others have ended: they are left as they would be
    without that one.
    """
    ended: dict[int, T] = {}
    errors: list[Exception] = []
    waiting: dict[int, BatchedCall] = {}
    kinds: dict[tuple[Any, ...], None] = {}  # in the order in which they come up
    answers: dict[int, Any] = dict.fromkeys(range(len(several)))
    while answers:
        for person, answer in answers.items():
            steps = several[person]
            try:
                waiting[person] = steps.throw(answer) if isinstance(answer, Exception) else steps.send(answer)
            except StopIteration as end:
                ended[person] = end.value
            except Exception as error:
                errors.append(error)
        kinds.update(dict.fromkeys(_kind(work) for work in waiting.values()))
        now = next((kind for kind in kinds if any(_kind(work) == kind for work in waiting.values())), None)
        chosen = [person for person, work in waiting.items() if _kind(work) == now]
        answers = dict(zip(chosen, _done([waiting.pop(person) for person in chosen])))
    if errors:
        raise errors[0]
    return [ended[person] for person in range(len(several))]


def _kind(work: BatchedCall) -> tuple[Any, ...]:
    """What of several can be done at once: the same method, with the same optional arrays present."""
    return type(work.part), work.method, *(_absent_fields(argument) for argument in work.arguments)


def _absent_fields(argument: Any) -> tuple[str, ...]:
    """Names of a dataclass' fields that are None."""
    if isinstance(argument, np.ndarray):
        return ()
    return tuple(name for name, value in vars(argument).items() if value is None)


def _done(works: Sequence[BatchedCall]) -> list[Any]:
    """What comes of works of one kind, each person's answer or error."""
    if len(works) > 1:
        try:
            return _done_at_once(works)
        except Exception:  # somebody's; nobody has got anything of it yet
            pass
    answers = []
    for work in works:
        try:
            answers.append(work.done())
        except Exception as error:
            answers.append(error)
    return answers


def _done_at_once(works: Sequence[BatchedCall]) -> list[Any]:
    parts, kind = [work.part for work in works], type(works[0].part)
    method, whole = getattr(kind, works[0].method), kind.stack(parts)
    for name in method.takes:
        setattr(whole, name, stack_values([getattr(part, name) for part in parts]))
    answer = method(whole, *map(stack_values, zip(*(work.arguments for work in works))))
    for name in method.gives:
        given = getattr(whole, name)
        for person, part in enumerate(parts):
            setattr(part, name, select_person(given, person))
    return [select_person(answer, person) for person in range(len(works))]


def stack_attribute(several: Sequence[T], attribute: str) -> T:
    """A copy of the first of several with this array of all: people, an axis of length 1 for their states, and on."""
    whole = copy(several[0])
    setattr(whole, attribute, np.array([getattr(one, attribute) for one in several])[:, None])
    return whole


def stack_values(values: Sequence[Any]) -> Any:
    """Arrays with a new first axis; dataclasses of arrays by their fields."""
    first = values[0]
    if isinstance(first, np.ndarray):
        return np.array(values)
    if first is None:
        return None
    return type(first)(*(stack_values([vars(value)[name] for value in values]) for name in vars(first)))


def select_person(value: Any, person: int) -> Any:
    """One person's of what `stacked` gave, or of what was made of it."""
    if value is None or isinstance(value, np.ndarray):
        return None if value is None else value[person]
    return type(value)(*(select_person(field, person) for field in vars(value).values()))
