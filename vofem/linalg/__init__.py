"""Numerical building blocks that know nothing of mechanics: eigensystems, exponentials, banded solves."""
