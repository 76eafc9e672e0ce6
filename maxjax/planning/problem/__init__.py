"""A problem as a planner takes it: maps, ends, distances to keep, exemptions."""
