"""Records: the files that a run leaves on disk."""
