"""Classical planners on the same grid, margin and problem: the rivals of the field."""
