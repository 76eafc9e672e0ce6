"""Windows: the part of a map in which a route is found and proved."""
