"""The quadrotor, its controller, and what disturbs them."""
