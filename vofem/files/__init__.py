"""Files without mechanics: written whole or not at all, locked, checked when read."""
