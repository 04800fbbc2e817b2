"""A problem in YAML as it is stated: its parts, symbols, members and model."""
