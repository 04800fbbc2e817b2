"""Kinds of scenario: what each poses, measures and draws."""
