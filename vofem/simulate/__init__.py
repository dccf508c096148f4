"""Simulations: the choice of a method, checks of arguments, runs and explanations."""
