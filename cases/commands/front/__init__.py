"""The front of the command line: its parser, its options, and the call of commands."""
