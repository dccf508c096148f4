"""The command line: ``vofem run``, ``explain``, ``verify`` and more. Only this package prints and ends processes."""

from vofem.cli.common import FAULT, FINE, INTERRUPTED
from vofem.cli.program import main

__all__ = ["FAULT", "FINE", "INTERRUPTED", "main"]
