"""Maps that a flight builds of its scans."""
