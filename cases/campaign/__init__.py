"""Runs, one or many: single runs, comparisons of solvers, replication of claims."""
