"""From a potential, or a graph, to a verified path."""
