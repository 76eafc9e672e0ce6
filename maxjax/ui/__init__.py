"""What a user meets: command line, figures, page."""
