"""Sensors of a flight."""
