"""What a flight costs a battery: multirotors with their sources, power, wind, charge along it, the way home."""
