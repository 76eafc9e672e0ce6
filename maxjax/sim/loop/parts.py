"""Parts of a flight: objects of different classes, each found by its class."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

T = TypeVar("T")
P = TypeVar("P", bound="Parts")


def part_of(parts: tuple[Any, ...], kind: type[T]) -> T:
    """The part of a class.

    Raises:
        ValueError: where there is none.
    """
    for part in parts:
        if isinstance(part, kind):
            return part
    given = ", ".join(type(part).__name__ for part in parts) or "nothing"
    raise ValueError(f"expected a flight built with {kind.__name__}, given one with {given}: add it to its extensions")


def with_part(parts: tuple[Any, ...], part: Any) -> tuple[Any, ...]:
    """Parts with one in place of that of its class, or after all others."""
    classes = [type(one) for one in parts]
    row = classes.index(type(part)) if type(part) in classes else len(classes)
    return (*parts[:row], part, *parts[row + 1 :])


@dataclasses.dataclass(frozen=True)
class Parts:
    """A holder of parts, for subclasses; `parts` are the pytrees that extensions of a flight keep in it."""

    parts: tuple[Any, ...] = dataclasses.field(default=(), kw_only=True)

    def has(self, kind: type) -> bool:
        """Whether there is a part of a class."""
        return any(isinstance(part, kind) for part in self.parts)

    def part(self, kind: type[T]) -> T:
        """The part of a class; raises a ValueError where there is none."""
        return part_of(self.parts, kind)

    def with_part(self: P, part: object) -> P:
        """The same with a part in place of that of its class, or after all others."""
        return dataclasses.replace(self, parts=with_part(self.parts, part))
