"""Words for what a command has found: outcomes, measures, excesses, failures."""
