"""Names and units of what is drawn, vehicles among them, and their surroundings."""
