"""Reconfiguration: UAVs go from one formation into another (the chapter's 5.4)."""
