"""What an autopilot flies: plans and trajectories as files of other programs, and where they lie on Earth."""
