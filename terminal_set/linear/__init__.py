"""The linear design: K and P by python-control, stability, level and ellipsoid.

All is matrices here; what holds for the nonlinear system is proven in `proving`.
"""
