"""The rules of the air: altitude band and areas, and their GeoJSON."""
