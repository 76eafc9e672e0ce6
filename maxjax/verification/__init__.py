"""The verifier of every path: exact, in float64, on `core` and `compile.native` alone."""
