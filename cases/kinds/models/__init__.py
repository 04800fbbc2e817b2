"""Models that scenarios can name."""
