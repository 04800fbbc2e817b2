"""Scenarios, the command line, records and figures: the rooms a user meets first."""
