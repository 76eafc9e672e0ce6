"""User interfaces: command line, figures, page."""
