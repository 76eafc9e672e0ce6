"""Faults of a flight: what fails, and what that does."""
