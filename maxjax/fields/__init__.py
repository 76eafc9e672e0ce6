"""Fields on the voxel grid: occupancy, conductivity, the stencil, its certificate and its gradient."""
