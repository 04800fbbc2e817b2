"""Runs, one or many: cells, solvers, comparison, replication, claims."""
