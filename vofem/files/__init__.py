"""Files without mechanics: written whole or not at all, and checked when read."""
