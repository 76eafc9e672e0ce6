"""Search on the lattice of voxels: the cheapest path between two, in Python and compiled."""
