"""The verifier of every path: exact, in float64 NumPy, on `core` alone."""
