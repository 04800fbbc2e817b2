"""The front of the command line: its parser, its options and what it invokes."""
