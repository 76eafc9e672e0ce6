"""Solvers of the conduction potential."""
