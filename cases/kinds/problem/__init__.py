"""Problems that a user states in YAML: any model, costs and constraints."""
