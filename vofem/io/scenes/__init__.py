"""Scene files from the inside: the table of what may stand in one, reading and writing."""
