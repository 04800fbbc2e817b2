"""Problems that a user states in Python; their files are run only if allowed."""
