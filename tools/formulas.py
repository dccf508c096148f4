"""A Markdown extension: ``$...$`` and ``$$...$$`` become MathML, which browsers draw without any script."""

from __future__ import annotations

import re
from typing import Any
from xml.etree import ElementTree

from latex2mathml.converter import convert
from markdown import Extension, Markdown
from markdown.inlinepatterns import InlineProcessor

#: A formula between dollars. One dollar needs a character beside it that is no space, so that prices stay prices.
_DISPLAYED = r"\$\$(?P<formula>.+?)\$\$"
_INLINE = r"(?<![\\$])\$(?P<formula>[^\s$](?:[^$]*[^\s$])?)\$(?![\d$])"


class _Formula(InlineProcessor):
    """Replace a formula by MathML, which later patterns must not touch."""

    def __init__(self, pattern: str, md: Markdown, display: str) -> None:
        super().__init__(pattern, md)
        self._display = display

    def handleMatch(self, m: re.Match[str], data: str) -> tuple[Any, int, int]:
        """Return the place holder of the MathML, and where the formula begins and ends."""
        mathml = convert(m["formula"].strip(), display=self._display)
        ElementTree.fromstring(mathml)
        return self.md.htmlStash.store(mathml), m.start(0), m.end(0)


class FormulaExtension(Extension):
    """Formulas between dollars."""

    def extendMarkdown(self, md: Markdown) -> None:
        """Add both patterns: after code, whose dollars stay, and before escapes."""
        md.inlinePatterns.register(_Formula(_DISPLAYED, md, "block"), "displayed_formula", 186)
        md.inlinePatterns.register(_Formula(_INLINE, md, "inline"), "formula", 185)


def makeExtension(**options: Any) -> FormulaExtension:
    """Return the extension."""
    return FormulaExtension(**options)
