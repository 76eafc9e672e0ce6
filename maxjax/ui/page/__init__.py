"""The page in the browser (extra `view`): plan by hand, look into the field, play flights, share all of it."""
