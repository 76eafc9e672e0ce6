"""Many vehicles in one air: each is told the others' committed motions, late, and swaps its own by an agreement."""
