"""Output of pages that do not show all of it: what their examples must print."""

from __future__ import annotations

PRINTED = {
    "any_problem.md": """
        2.0 2.0
        [ 0.02 -0.06]
        [-0.187 -0.239]
        3.0 1.5
        {'duration of phase 1': ...
        2.98 ...
        0.73 1.36
        0.2
        ('x_0', 'x_1', 'x_2') [0.254 0.13 0.254]
        ('u_0', 'u_1', 'u_2') True
        ('x', 'gain') 0
        (1, 2)
        5
        [[-1.5 -0.9 -0.3  0.3  0.9  1.5]] 1.5
        whole numbers cost ..., relaxed ...: ... % apart
        ('z',) (1, 11)
    """,
    "library.md": """
        36.713
        36.713
        [(36.71, ...)]
        Solutions of 4 instances in ...
        4 CONVERGED: a local optimum, confirmed on the finer grid
        ...
        [36.71 21.39 11.28  6.7 ] (2, 51, 4)
        CONVERGED lanes guess
        [20.36 24.56]
        ('angle', 'speed') ...
        Run of formation_v, ...
        ...
        problem 1, ipopt: 1 of 1 feasible, ...
        ...
    """,
}
"""Lines by page, with gaps and rounded numbers as `comparing` reads them."""
