"""Numerical building blocks that do not depend on mechanics: eigensystems, exponentials, banded solves."""
