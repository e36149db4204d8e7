"""The mutants of a file: cosmic-ray's operators, and two more that it lacks.

Left out are mutants that no test can notice by construction: those inside of annotations and of `assert` (which informs
the type checker what holds anyway), `is` in place of `==`, and those whose syntax tree is the original's.
"""

from __future__ import annotations

import ast
import random
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import parso
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.operator import Operator
from cosmic_ray.plugins import get_operator, operator_names

IDENTITY = ("_Eq_Is", "_NotEq_IsNot", "_Is_Eq", "_IsNot_NotEq")
"""Ends of the names of operators that swap equality and identity: the same for None, enumerations and small numbers."""

Position = tuple[int, int]


@dataclass(frozen=True)
class Mutant:
    """One changed file."""

    path: Path
    line: int
    operator: str
    code: str


class RemoveCall(Operator):
    """A call whose result is not used becomes `pass`."""

    def mutation_positions(self, node: Any) -> Iterator[tuple[Position, Position]]:
        """The call of a statement that is nothing but a call."""
        if node.type == "simple_stmt" and node.children[0].type in ("atom_expr", "power"):
            yield node.children[0].start_pos, node.children[0].end_pos

    def mutate(self, node: Any, index: int) -> Any:
        """The statement with `pass` in place of the call."""
        prefix = node.children[0].get_first_leaf().prefix
        node.children[0] = parso.python.tree.Name("pass", node.children[0].start_pos, prefix)
        return node

    @classmethod
    def examples(cls) -> Sequence[Any]:
        """None."""
        return ()


class ReturnNone(Operator):
    """A function returns None in place of its result."""

    def mutation_positions(self, node: Any) -> Iterator[tuple[Position, Position]]:
        """What stands behind `return`."""
        if node.type == "return_stmt" and node.children[1].get_code().strip() != "None":
            yield node.children[1].start_pos, node.children[1].end_pos

    def mutate(self, node: Any, index: int) -> Any:
        """The statement with None in place of the value."""
        node.children[1] = parso.python.tree.Name("None", node.children[1].start_pos, " ")
        return node

    @classmethod
    def examples(cls) -> Sequence[Any]:
        """None."""
        return ()


def operators() -> dict[str, Operator]:
    """All operators that need no arguments, by name."""
    kinds = {name.split("/")[1]: get_operator(name) for name in operator_names() if not name.endswith(IDENTITY)}
    usable = {name: kind() for name, kind in kinds.items() if not kind.arguments()}
    return {**usable, "RemoveCall": RemoveCall(), "ReturnNone": ReturnNone()}


def left_out(code: str) -> list[tuple[Position, Position]]:
    """Where the annotations and assertions of a module stand: (first line, column), (last line, column)."""
    nodes: list[Any] = []
    for node in ast.walk(ast.parse(code)):
        nodes += [getattr(node, "annotation", None), getattr(node, "returns", None)]
        nodes += [node] if isinstance(node, ast.Assert) else []
    return [((n.lineno, n.col_offset), (n.end_lineno, n.end_col_offset)) for n in nodes if n is not None]


def places(code: str) -> dict[tuple[Any, ...], list[tuple[str, Operator, int]]]:
    """What can be mutated, by place and kind: the (name, operator, occurrence) of each of the mutants there."""
    ranges = left_out(code)
    tree = get_ast(code)
    found = defaultdict(list)
    for name, operator in operators().items():
        positions = (spot for node in ast_nodes(tree) for spot in operator.mutation_positions(node))
        for occurrence, (start, end) in enumerate(positions):
            if not any(first <= start and end <= last for first, last in ranges):
                found[(start, end, name.split("_")[0])].append((name, operator, occurrence))
    return dict(found)


def sample(paths: Sequence[Path], number: int, random_: random.Random) -> Iterator[Mutant]:
    """Draw up to `number` mutants: places with equal probability, then one of the mutants of the place."""
    codes = {path: path.read_text(encoding="utf-8") for path in paths}
    drawn = [(path, key, some) for path, code in codes.items() for key, some in sorted(places(code).items())]
    random_.shuffle(drawn)
    for path, ((line, _), _, _), choices in drawn:
        if number == 0:
            return
        name, operator, occurrence = random_.choice(choices)
        code = mutate_code(codes[path], operator, occurrence)
        if code is not None and _differs(codes[path], code):
            number -= 1
            yield Mutant(path, line, name, code)


def _differs(code: str, mutated: str) -> bool:
    """Whether the mutant is valid Python and another program."""
    try:
        return ast.dump(ast.parse(code)) != ast.dump(ast.parse(mutated))
    except SyntaxError:
        return False
