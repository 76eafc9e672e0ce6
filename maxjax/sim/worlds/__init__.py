"""Simulated cities: procedural and surveyed ones, ray casting, exact distance and occupancy."""
