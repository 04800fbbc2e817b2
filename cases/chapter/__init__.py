"""What only the claims of the chapter need, and no simulation measures."""
