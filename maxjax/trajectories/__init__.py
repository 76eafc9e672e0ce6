"""From a path to a flight in time: corners rounded, speeds, headings; on the host, and online for flights."""
