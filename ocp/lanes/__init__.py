"""Local solves of many starts at once, each in a SIMD lane."""
