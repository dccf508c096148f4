"""Following curves of orbits and of special points along parameters."""
