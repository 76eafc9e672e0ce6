"""Files for autopilots: plans and trajectories in the formats of other programs, and where they lie on Earth."""
