"""One run of a scenario: simulated, measured, judged and recorded."""
