"""Kinds of scenario, each with its problems, measures and figures."""
