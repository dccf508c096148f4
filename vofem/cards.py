"""How notebooks show runs, orbits, branches and scenes."""

from __future__ import annotations


class Shown:
    """What notebooks show as a card."""

    def _repr_html_(self) -> str:
        # Late, because results, studies and scenes know no pictures and no HTML.
        from vofem.io.cards import card_of

        return card_of(self)
