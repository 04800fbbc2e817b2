"""The terminal: output, and the progress that it shows."""
