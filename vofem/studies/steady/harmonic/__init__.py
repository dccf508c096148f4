"""Orbits by harmonic balance, and their multipliers."""
