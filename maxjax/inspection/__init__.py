"""Viewpoints, coverage, surveys and their order: work to fly with a camera."""
