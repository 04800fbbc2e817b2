"""swarmstart: warm starts for nonlinear optimal control by population search."""

__version__ = "0.1.0"
