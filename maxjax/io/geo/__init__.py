"""Triangles and outlines on a grid of voxels."""
