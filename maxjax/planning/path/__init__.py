"""From a potential to a path: ascent, string pulling, line of sight."""
