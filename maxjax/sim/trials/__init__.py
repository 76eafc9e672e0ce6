"""Closed-loop trials: drawn from a key, flown in batches, kept in a ledger, summarised."""
