"""Benchmarks: one script a subject, one harness; results/ holds what they saved, with provenance."""
