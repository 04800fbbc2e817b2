"""Studies of many runs: comparisons of solvers, the replication, bounds compared."""
