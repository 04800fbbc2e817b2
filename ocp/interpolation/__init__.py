"""Tables and splines in expressions, and smooth forms of switches."""
