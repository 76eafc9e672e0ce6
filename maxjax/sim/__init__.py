"""Simulated worlds: procedural cities, ray casting and a LiDAR."""
