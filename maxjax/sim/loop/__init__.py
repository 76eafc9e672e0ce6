"""The closed loop of one flight: its state and its stages."""
