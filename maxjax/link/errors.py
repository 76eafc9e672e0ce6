"""Why a flight over a link did not take place, or ended early: a sentence."""

from __future__ import annotations


class LinkError(Exception):
    """A flight that did not take place or ended early; the message says what was expected, found, and what to do.

    Attributes:
        holds: whether the vehicle is to be told to hold its place; not where it is flown by someone else, or on the
            ground.
    """

    def __init__(self, sentence: str, *, holds: bool = True) -> None:
        super().__init__(sentence)
        self.holds = holds
