"""Experiments: one script a table or figure, each with a `main(config)`; results/ holds what they wrote."""
