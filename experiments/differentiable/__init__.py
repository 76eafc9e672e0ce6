"""What only a differentiable, certified planner can do: inverse problems, design, learning, sensitivity."""
