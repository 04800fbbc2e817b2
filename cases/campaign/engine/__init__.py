"""Cells, the units of work of a campaign, in processes on this machine or a cluster."""
