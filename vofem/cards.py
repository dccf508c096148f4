"""How notebooks show runs, orbits, branches and scenes: what these ask of a presenter, and which one they find.

Results, studies and scenes know no pictures and no HTML. `vofem/__init__.py`, which stands above all rooms, names the
presenter; it is opened when a notebook asks for a card.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

#: Returns a card as HTML.
Presenter = Callable[[Any], str]

_openers: list[Callable[[], Presenter]] = []


def use_presenter(opener: Callable[[], Presenter]) -> None:
    """Name the presenter from now on by a function that opens it; it is called when a card is wanted."""
    _openers[:] = [opener]


def card(thing: Any) -> str | None:
    """Return the card of a thing as HTML; None where no presenter was named, so that a notebook shows its repr."""
    return _openers[0]()(thing) if _openers else None


class Shown:
    """What notebooks show as a card."""

    def _repr_html_(self) -> str | None:
        return card(self)
