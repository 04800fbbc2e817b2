"""The form of a scenario: text, expressions, settings, and what a kind must offer."""
