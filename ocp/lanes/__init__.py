"""Local solves of many starts at once, each in a lane of vector registers (SIMD)."""
