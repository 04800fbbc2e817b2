"""Scenarios, the command line, records and figures: the folders a user meets first."""
