"""Transfer: UAVs fly to their goals in a given time, as one optimal-control problem."""
