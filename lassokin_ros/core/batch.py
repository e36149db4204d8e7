"""Batching: run the trackers of several people together and compute equal work at once.

numpy takes hardly longer for the arrays of ten people than for those of one. A tracker's step is therefore a generator:
it yields expensive work as a `BatchedCall` and continues with the result. Calls of the same kind are executed together,
by a stacked object whose arrays have a leading axis of people.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from copy import copy
from typing import Any, NamedTuple, TypeVar

import numpy as np

T = TypeVar("T")


class BatchedCall(NamedTuple):
    """A call of a `batched` method of a tracker's part. The arguments are arrays or dataclasses of arrays."""

    part: Any
    method: str
    arguments: tuple[Any, ...]

    def done(self) -> Any:
        """Execute the call and return its result."""
        return getattr(self.part, self.method)(*self.arguments)


Kind = tuple[Any, ...]
"""Key of calls that can be executed together."""

Steps = Generator[BatchedCall, Any, T]
"""A generator for `run_single` and `run_batched` that returns a T."""


def batched(reads: Sequence[str], writes: Sequence[str]) -> Callable[[T], T]:
    """Mark a method that can process several people at once; arrays then have a leading axis of people.

    Its class has a static method `stack(several)` that returns a copy for several people. reads, writes: names of the
    per-person attributes that the method reads and sets.
    """

    def mark(method: T) -> T:
        method.reads, method.writes = reads, writes  # type: ignore[attr-defined]
        return method

    return mark


def run_single(steps: Steps[T]) -> T:
    """Run the steps of one person. Each call is executed at once."""
    try:
        work = next(steps)
        while True:
            work = steps.send(work.done())
    except StopIteration as end:
        return end.value  # type: ignore[no-any-return]


def run_batched(several: Sequence[Steps[T]]) -> list[T]:
    """Run the steps of several people and return the results in order. People wait for those with earlier calls.

    If some raise, the others still run to the end, as they would alone; then the first error is raised.
    """
    ended: dict[int, T] = {}
    errors: list[Exception] = []
    waiting: dict[int, tuple[Kind, BatchedCall]] = {}
    kinds: dict[Kind, None] = {}  # in the order of their first occurrence
    answers: dict[int, Any] = dict.fromkeys(range(len(several)))
    while answers:
        for person, answer in answers.items():
            steps = several[person]
            try:
                work = steps.throw(answer) if isinstance(answer, Exception) else steps.send(answer)
                waiting[person] = _kind(work), work
            except StopIteration as end:
                ended[person] = end.value
            except Exception as error:
                errors.append(error)
        present = dict.fromkeys(kind for kind, _ in waiting.values())
        kinds.update(present)
        now = next((kind for kind in kinds if kind in present), None)
        chosen = [person for person, (kind, _) in waiting.items() if kind == now]
        answers = dict(zip(chosen, _done([waiting.pop(person)[1] for person in chosen])))
    if errors:
        raise errors[0]
    return [ended[person] for person in range(len(several))]


def _kind(work: BatchedCall) -> Kind:
    """Key of calls that can be executed together: the same method, with the same optional arrays present."""
    return type(work.part), work.method, *(_absent_fields(argument) for argument in work.arguments)


def _absent_fields(argument: Any) -> tuple[str, ...]:
    """Names of a dataclass' fields that are None."""
    if isinstance(argument, np.ndarray):
        return ()
    return tuple(name for name in argument.__dataclass_fields__ if getattr(argument, name) is None)


def _done(works: Sequence[BatchedCall]) -> list[Any]:
    """Results of calls of one kind: each person's answer or error."""
    if len(works) > 1:
        try:
            return _done_at_once(works)
        except Exception:  # one person's call failed; no attribute has been set yet
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
    for name in method.reads:
        setattr(whole, name, stack_values([getattr(part, name) for part in parts]))
    answer = method(whole, *map(stack_values, zip(*(work.arguments for work in works))))
    for name in method.writes:
        given = getattr(whole, name)
        for person, part in enumerate(parts):
            setattr(part, name, select_person(given, person))
    return [select_person(answer, person) for person in range(len(works))]


def stack_attribute(several: Sequence[T], attribute: str) -> T:
    """A copy of the first object with the stacked attribute (people, 1, ...); the second axis is for states."""
    whole = copy(several[0])
    setattr(whole, attribute, np.array([getattr(one, attribute) for one in several])[:, None])
    return whole


def stack_values(values: Sequence[Any]) -> Any:
    """Stack arrays along a new first axis; dataclasses of arrays field by field."""
    first = values[0]
    if isinstance(first, np.ndarray):
        return np.array(values)
    if first is None:
        return None
    fields = first.__dataclass_fields__
    return type(first)(*(stack_values([getattr(value, name) for value in values]) for name in fields))


def select_person(value: Any, person: int) -> Any:
    """Select one person from a value with a leading axis of people, such as those of `stack_values`."""
    if value is None or isinstance(value, np.ndarray):
        return None if value is None else value[person]
    return type(value)(*(select_person(getattr(value, name), person) for name in value.__dataclass_fields__))
