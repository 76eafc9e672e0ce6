"""Grid geometry, status codes, interpolation and serialisation: what every other floor stands on."""
