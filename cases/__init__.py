"""What a user meets first: scenarios, the command line, records and figures."""
