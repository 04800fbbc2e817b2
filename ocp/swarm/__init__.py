"""Many vehicles: committed plans that never collide, and the rule that replaces them.

A vehicle's committed plan ends in a place that it can keep for ever, and is replaced
only by one that all others have accepted; so delays and lost messages cost time only.
"""
