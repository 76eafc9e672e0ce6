"""Kinds of content that map files hold, each made voxels in its own way."""
