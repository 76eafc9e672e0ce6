"""Readers of map files: one file a format."""
