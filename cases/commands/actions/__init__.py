"""The actions of the command line, one module a command."""
