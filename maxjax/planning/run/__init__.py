"""Stages in order: staged, fused, batched, in flight."""
