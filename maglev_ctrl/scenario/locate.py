"""Where each key of a TOML text stands; loaded only when an error has to be placed."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from typing import TYPE_CHECKING

from maglev_ctrl.scenario.problems import Fault, KeyPath, Problem, key_text

if TYPE_CHECKING:
    from tree_sitter import Node


@dataclass(frozen=True, slots=True)
class Place:
    """Line and column, counted from 1, of a key and of its value; `span`: bytes of the value in the text."""

    key: tuple[int, int]
    value: tuple[int, int]
    span: tuple[int, int] = (0, 0)


def place_faults(text: str, faults: list[Fault]) -> list[Problem]:
    """Faults with their positions; what is missing gets the position of the table it is missing from."""
    places = key_places(text)
    problems = []
    for fault in faults:
        path = fault.path
        while path and path not in places:
            path = path[:-1]
        place = places.get(path, Place((1, 1), (1, 1)))
        line, column = place.key if fault.at_key or path != fault.path else place.value
        problems.append(Problem(line, column, key_text(fault.path), fault.message))
    return problems


def key_places(text: str) -> dict[KeyPath, Place]:
    """Positions of every key, table and list item of a valid TOML text.

    Examples
    --------
    >>> key_places('[a]\\nb.c = {d = [1, 2]}')[("a", "b", "c", "d", 1)].value
    (2, 16)
    """
    import tree_sitter
    import tree_sitter_toml

    parser = tree_sitter.Parser(tree_sitter.Language(tree_sitter_toml.language()))
    source = text.encode()
    walk = _Walk(source.split(b"\n"))
    for node in parser.parse(source).root_node.named_children:
        match node.type:
            case "pair":
                walk.pair(node, prefix=())
            case "table" | "table_array_element":
                walk.table(node, is_list=node.type == "table_array_element")
    return walk.places


class _Walk:
    """Collects positions while the tree is walked."""

    def __init__(self, lines: list[bytes]) -> None:
        self.lines = lines
        self.places: dict[KeyPath, Place] = {}
        self.lengths: dict[KeyPath, int] = {}

    def table(self, node: Node, *, is_list: bool) -> None:
        key, *rest = [child for child in node.named_children if child.type != "comment"]
        *parents, last = self._parts(key)
        path: KeyPath = ()
        for part in parents:
            path = self._newest((*path, part))
            self.places.setdefault(path, self._place(key))
        path = (*path, last)
        if is_list:
            self.lengths[path] = self.lengths.get(path, 0) + 1
            self.places.setdefault(path, self._place(key))
            path = self._newest(path)
        self.places[path] = Place(self._position(key), self._position(key))  # its value is all that follows: no span
        for child in rest:
            if child.type == "pair":
                self.pair(child, prefix=path)

    def pair(self, node: Node, *, prefix: KeyPath) -> None:
        key, value = [child for child in node.named_children if child.type != "comment"][:2]
        *parents, last = self._parts(key)
        for part in parents:
            prefix = (*prefix, part)
            self.places.setdefault(prefix, self._place(key))
        path = (*prefix, last)
        self.places[path] = Place(self._position(key), self._position(value), (value.start_byte, value.end_byte))
        self._inside(value, path)

    def _inside(self, value: Node, path: KeyPath) -> None:
        children = [child for child in value.named_children if child.type != "comment"]
        if value.type == "inline_table":
            for child in children:
                self.pair(child, prefix=path)
        elif value.type == "array":
            for index, child in enumerate(children):
                self.places[(*path, index)] = self._place(child)
                self._inside(child, (*path, index))

    def _newest(self, path: KeyPath) -> KeyPath:
        """The newest item of a list of tables, or the path itself."""
        return (*path, self.lengths[path] - 1) if path in self.lengths else path

    def _parts(self, key: Node) -> list[str]:
        if key.type == "dotted_key":
            return [part for child in key.named_children for part in self._parts(child)]
        text = (key.text or b"").decode()
        if key.type == "bare_key":
            return [text]
        return [next(iter(tomllib.loads(f"{text} = 0")))]

    def _place(self, node: Node) -> Place:
        return Place(self._position(node), self._position(node), (node.start_byte, node.end_byte))

    def _position(self, node: Node) -> tuple[int, int]:
        row, column = node.start_point
        return row + 1, len(self.lines[row][:column].decode(errors="replace")) + 1
