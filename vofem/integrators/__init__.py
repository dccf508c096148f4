"""Integrators: each sees a System and an initial state, and knows nothing of beams, masses or scenes."""
