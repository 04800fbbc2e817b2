"""Search for starts: the space of decisions, population searches, lanes, many starts.

The account says which start led to which answer, and what it took.
"""
