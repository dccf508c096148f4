"""Orbits by shooting: a run over a period in segments between switches, whose lengths are unknowns."""
