"""Computations that only the chapter's claims need, and no simulation measures."""
