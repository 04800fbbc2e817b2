"""An SX casadi.Function -> an evaluator of whole populations."""
