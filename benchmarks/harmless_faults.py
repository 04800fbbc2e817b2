"""Faults that make no proof, status or verdict wrong, each with the reason.

They change text that is only read, effort, or nothing at all. A place is named by the
line's text, so that it is still found after lines above it have changed.
"""

TEXT = "text that is read, and nothing is decided by"
EFFORT = "how much is tried; what is found is checked by itself"
GUARD = "avoids 0/0 only"
EQUAL = "differs where two computed real numbers are equal in all bits only"
EMPTY = "both are empty, or zeros of the same shape"
AT_ZERO = "at 0 the square of the end is 0 as well"
DIRECTION = "only the direction of w counts"

MIDDLE = "a middle is as far from both ends, but for its own rounding"

_ANY: dict[str, dict[str, tuple[str, ...]]] = {
    EFFORT: {
        "terminal_set/checker/coordinates.py": ("_SWEEPS = 60",),
        "terminal_set/checker/falsification.py": (
            "SAMPLES = 200",
            "REFINEMENT = 32  # Runge-Kutta steps of the flow a step of the map",
            "TIMES = 8  # instants within a hold",
            "yield from _on_spheres(certificate, T, lambda _: 1 - 1e-12)",
        ),
        "terminal_set/checker/motion.py": (
            "_STEPS_A_LOOK = 256  # instructions between looks at the clock; "
            "well below 1 ms",
        ),
        "terminal_set/enclosure.py": (
            "spread[0] = np.where(inner, np.where(quadratic < 0, np.inf, 0.0), "
            "spread[0])",
        ),
        "terminal_set/held_motion.py": (
            "SAMPLES = 500",
            "RADII = (0.01, 0.3, 0.6, 0.8, 0.9, 1.0)",
            "TIMES = 50",
        ),
        "terminal_set/interval_kernel.py": ("BLOCK = 256",),
        "terminal_set/proof.py": ("CHUNK = 8192",),
        "terminal_set/refutation.py": (
            "RAYS = 4000",
            "RADII = 60",
            "SMALLEST = 1e-3",
            "STARTS = 6",
            "MOST_ROUNDS = 4",
            "if not starts or starts[0][0] > radius / 10:",
            "starts = _on_rays(c, T, radius, rng) or starts[:1]",
            "condition = c(ca.DM(T) @ (rho * u)) / rho**2",
            "lbx=np.concatenate([[1e-6 * radius], np.full(nx, -1.0)]),",
        ),
        "terminal_set/flow_error.py": (
            "PIECES = 8",
            "POINTS = 64",
            "rho = self._radius * np.linspace(0.5, 1.0, POINTS)",
            "if (_lengths(own_wide / mean, 0 * q) > reached / 10).any():",
            # How a cell is cut, and how sharp a bound has to be.
            "start = residual.start(last.step, z, 0 * z)",
            "change = np.linalg.norm(slopes(z + axis) - slopes(z - axis), axis=(1, 2))",
            "return size, 0 * size, _widths(cells)",
            "reached = np.fmin(reached, near)",
        ),
    },
    TEXT: {
        "ocp/path.py": ("_SHOWN = 5",),
        "ocp/solution.py": (
            "SHOWN = 6",
            "more = len(names) - SHOWN",
            'return "; ".join(parts) + (f"; and {more} more" if more > 0 else "")',
            "share = abs(path.cost - plan.cost) / max(path.magnitude, 1e-300)",
        ),
        "terminal_set/refutation.py": (
            '{"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"},',
        ),
    },
    GUARD: {
        "ocp/separation.py": (
            "_SHORTEST_SEGMENT = 1e-24",
            "shortest = _SHORTEST_SEGMENT * self.distance**2",
        ),
    },
    "a figure, drawn with more or fewer points": {
        "terminal_set/ellipsoid.py": (
            "def shadow(self, i: int, j: int, *, count: int = 201) -> Array:",
        ),
    },
    "any number but 0 would do": {
        "terminal_set/smoothness.py": ("NEIGHBOURHOOD = 1e-150",),
    },
    "any large weight: the form is only smaller than on the tangent space": {
        "ocp/optimality.py": ("_HELD = 1e7",),
    },
    "any factor above the rounding of T'PT, whose defect is added": {
        "terminal_set/proof.py": ("COVER = 1e-9",),
    },
}
"""Reason -> file -> lines of which every fault is harmless."""

_ONE: dict[str, dict[str, tuple[tuple[str, str], ...]]] = {
    EFFORT: {
        "terminal_set/level_search.py": tuple(
            (line, line.replace(share, other))
            for line, share, others in (
                ("if not search.proves(alpha_max, 0.25):", "0.25", ("0.5", "0.125")),
                (
                    "if self.proves(FIRST_SHARE * self._unproven, 0.7):",
                    "0.7",
                    ("1.4", "0.35"),
                ),
                (
                    "if self.proves(FIRST_SHARE * self._unproven, 0.7):",
                    "FIRST_SHARE *",
                    ("FIRST_SHARE /",),
                ),
                (
                    "if self.proves(share * self._unproven, 0.5):",
                    "share *",
                    ("share /",),
                ),
                (
                    "if self.proves(share * self._unproven, 0.5):",
                    "0.5",
                    ("1.0", "0.25"),
                ),
            )
            for other in others
        ),
        "terminal_set/flow_error.py": (
            (
                "met, bound, looked, will_do = at_least, -np.inf, 0, allowed(at_least)",
                "met, bound, looked, will_do = at_least, -np.inf, 1, allowed(at_least)",
            ),
        ),
        "terminal_set/growth.py": (
            ("max_seconds: float = 60.0,", "max_seconds: float = 30.0,"),
        ),
    },
    "a wider bound, and still one": {
        "terminal_set/flow_error.py": (
            (
                "return slopes((low + high) / 2, (high - low) / 2)",
                "return slopes((low + high) / 2, (high - low) * 2)",
            ),
            (
                "error += np.exp(max(speed, 0.0) * piece.length) * moved",
                "error += np.exp(max(speed, 1.0) * piece.length) * moved",
            ),
        ),
        "terminal_set/drift.py": (("ROUNDING = 1 + 1e-9", "ROUNDING = 1 + 2e-09"),),
    },
    "still far above the rounding of what it multiplies": {
        "terminal_set/drift.py": (("ROUNDING = 1 + 1e-9", "ROUNDING = 1 + 5e-10"),),
    },
    "a kink or none in the one box that is asked for": {
        "terminal_set/enclosure.py": (
            (
                "self._is_kinked = bool(kinks(zero, zero)[0].any())",
                "self._is_kinked = bool(kinks(zero, zero)[0].all())",
            ),
        ),
    },
    "the same two neighbours, the other one first": {
        "ocp/solution.py": tuple(
            (line, line.replace("+ part", "- part"))
            for line in (
                "moved = controls + part * sizes.controls[:, None] * signs",
                "yield controls, x0 + part * sizes.states",
            )
        ),
    },
    "refused all the same, in other words": {
        "terminal_set/checker/certificate_file.py": tuple(
            (line, line.replace("10**9", other))
            for line in ('if _integer(content["version"], "version", 0, 10**9) != 1:',)
            for other in ("10**18", "20**9")
        ),
    },
    "sweeps beyond the last that changes anything": {
        "terminal_set/checker/coordinates.py": (
            (
                "rest = sum(a[i][j] ** 2 for i in range(n) for j in range(n) "
                "if i != j)",
                "rest = sum(a[i][j] ** 2 for i in range(n) for j in range(n) "
                "if i == j)",
            ),
        ),
    },
    "the same number once more, computed from itself": {
        "terminal_set/checker/coordinates.py": (
            ("for i in range(j + 1, n):", "for i in range(j + 0, n):"),
        ),
    },
    MIDDLE: {
        "terminal_set/checker/decrease.py": (
            (
                "reach = (arb(high) - arb(c)).max(arb(c) - arb(low))",
                "reach = (arb(high) - arb(c)).max(arb(c) + arb(low))",
            ),
        ),
    },
    "no cell holds the origin: where w is 0, another entry is 1 or -1": {
        "terminal_set/cells.py": (
            ("outwards = sign * w >= 0", "outwards = sign * w > 0"),
            ("outwards = sign * w >= 0", "outwards = sign / w >= 0"),
        ),
    },
    "the root is at least that of the least growth, which is above 1": {
        "terminal_set/hold_margins.py": (
            (
                "room = SHRUNK * max((bounds.states / top) ** 0.5 - c, 0.0) ** 2",
                "room = SHRUNK * max((bounds.states / top) ** 0.5 - c, 1.0) ** 2",
            ),
        ),
    },
    "of a <= b and b <= a it does not matter which comes first": {
        "terminal_set/intervals.py": (
            (
                'operation, arguments = "ties", builder.nodes[arguments[0]].arguments',
                'operation, arguments = "ties", builder.nodes[arguments[1]].arguments',
            ),
        ),
    },
    "a quotient by a ball with 0 in it is not finite, and is left out": {
        "terminal_set/checker/decrease.py": (("if low > 0.0:", "if low >= 0.0:"),),
    },
    "only as many entries are read as there are states": {
        "ocp/checking.py": (
            (
                "found = self._path.worst(excess, above, np.zeros(1), sizes())",
                "found = self._path.worst(excess, above, np.zeros(2), sizes())",
            ),
        ),
    },
    "moved by one, it jumps at whole numbers all the same": {
        "ocp/kinks.py": (
            (
                '_WRAPS = {ca.OP_FMOD: ("fmod", 0.0), ca.OP_REMAINDER: '
                '("remainder", 0.5)}',
                '_WRAPS = {ca.OP_FMOD: ("fmod", 1.0), ca.OP_REMAINDER: '
                '("remainder", 0.5)}',
            ),
        ),
    },
    "less than one more, which is cut off": {
        "ocp/repair.py": (
            (
                "columns = np.linspace(0, path.times.size - 1, checks + 1)"
                ".astype(int)[1:]",
                "columns = np.linspace(1, path.times.size - 1, checks + 1)"
                ".astype(int)[1:]",
            ),
        ),
    },
    "NumPy takes any negative number for the size that is to be found": {
        "terminal_set/taylor.py": (
            (
                "turned = (tensor.reshape(-1, len(T)) @ T).reshape(tensor.shape)",
                "turned = (tensor.reshape(-2, len(T)) @ T).reshape(tensor.shape)",
            ),
        ),
    },
    EQUAL: {
        "cases/campaign/verdicts.py": (("if p > LEVEL:", "if p >= LEVEL:"),),
        "ocp/dual_mode.py": tuple(
            (
                "if np.any(at - reach < lower - SLACK) or "
                "np.any(at + reach > upper + SLACK):",
                after,
            )
            for after in (
                "if np.any(at - reach <= lower - SLACK) or "
                "np.any(at + reach > upper + SLACK):",
                "if np.any(at - reach < lower - SLACK) or "
                "np.any(at + reach >= upper + SLACK):",
            )
        ),
        "ocp/improving.py": (
            ("return one.cost < other.cost", "return one.cost <= other.cost"),
        ),
        "ocp/kinks.py": tuple(
            ("crossed = ((low <= near) & (high >= -near)).any(axis=1)", after)
            for after in (
                "crossed = ((low < near) & (high >= -near)).any(axis=1)",
                "crossed = ((low <= near) & (high > -near)).any(axis=1)",
            )
        ),
        "ocp/optimality.py": (
            (
                "return stationarity(point) <= STATIONARY_WITHIN",
                "return stationarity(point) < STATIONARY_WITHIN",
            ),
        ),
        "terminal_set/checker/falsification.py": (
            (
                "largest = grown if not grown <= largest else largest  # NaN is kept.",
                "largest = grown if not grown < largest else largest  # NaN is kept.",
            ),
        ),
        "terminal_set/hold_margins.py": (
            (
                "if is_affordable or clock.perf_counter() > until:",
                "if is_affordable or clock.perf_counter() >= until:",
            ),
        ),
        "terminal_set/level_search.py": (
            (
                "return clock.perf_counter() > self._until",
                "return clock.perf_counter() >= self._until",
            ),
            (
                "if change >= 0 and alpha <= self._alpha_max:",
                "if change >= 0 and alpha < self._alpha_max:",
            ),
        ),
        "terminal_set/growth.py": (
            (
                "proven = not shortest and clock.perf_counter() < until",
                "proven = not shortest and clock.perf_counter() <= until",
            ),
        ),
        "ocp/solution.py": (
            (
                "changes = not abs(moved.cost - path.cost) <= allowed",
                "changes = not abs(moved.cost - path.cost) < allowed",
            ),
            ("if (beyond > 0).any():", "if (beyond >= 0).any():"),
        ),
    },
    GUARD: {
        "ocp/solution.py": (
            (
                "i = int(np.argmax(beyond / np.maximum(scale, 1e-300)))",
                "i = int(np.argmax(beyond / np.maximum(scale, 2e-300)))",
            ),
            (
                "i = int(np.argmax(beyond / np.maximum(scale, 1e-300)))",
                "i = int(np.argmax(beyond / np.maximum(scale, 5e-301)))",
            ),
        ),
        "terminal_set/stability.py": tuple(
            (
                "columns = B / np.where(lengths > 0, lengths, 1.0) * "
                "(np.linalg.norm(A) or 1.0)",
                f"columns = B / np.where(lengths > 0, lengths, {other}) * "
                "(np.linalg.norm(A) or 1.0)",
            )
            for other in ("2.0", "0.5")
        ),
        "terminal_set/checker/coordinates.py": (
            (
                "factor[j][j] = math.sqrt(max(rest, 5e-324))",
                "factor[j][j] = math.sqrt(max(rest, 0.0))",
            ),
            (
                "factor[j][j] = math.sqrt(max(rest, 5e-324))",
                "factor[j][j] = math.sqrt(max(rest, 1e-323))",
            ),
        ),
    },
    AT_ZERO: {
        "terminal_set/cells.py": tuple(
            ("inside = (lower <= 0) & (upper >= 0)", after)
            for after in (
                "inside = (lower < 0) & (upper >= 0)",
                "inside = (lower <= 0) & (upper > 0)",
            )
        ),
        "terminal_set/checker/coordinates.py": tuple(
            (line, line.replace("a <= 0.0 <= b", between))
            for line in (
                "low2 = [0.0 if a <= 0.0 <= b else min(a * a, b * b) for a, b in w]",
                "arb(0) if a <= 0.0 <= b else square(arb(min(abs(a), abs(b)))) "
                "for a, b in w",
            )
            for between in ("a < 0.0 <= b", "a <= 0.0 < b")
        ),
    },
    "a search that cannot succeed is begun all the same": {
        "terminal_set/checker/decrease.py": (
            (
                "if s.times[0] == s.times[1] and not margin < 0:",
                "if s.times[0] == s.times[1] and not margin <= 0:",
            ),
        ),
    },
    "a default for the type checker: the reader leaves no None there": {
        "terminal_set/checker/ellipsoid_statements.py": tuple(
            (line, line.replace("or 1.0", other))
            for line in (
                "growth = arb(self.certificate.growth or 1.0)",
                "weight=arb(certificate.growth or 1.0),",
            )
            for other in ("or 0.0", "or 2.0")
        ),
        "terminal_set/checker/drift.py": (
            (
                "substeps = certificate.substeps or 1",
                "substeps = certificate.substeps or 2",
            ),
        ),
        "terminal_set/checker/falsification.py": (
            (
                "growth, dt = certificate.growth or 1.0, certificate.dt or 0.0",
                "growth, dt = certificate.growth or 1.0, certificate.dt or 1.0",
            ),
        ),
    },
    DIRECTION: {
        "terminal_set/cells.py": tuple(
            (
                "self.radii, w = (lower[0], upper[0]), (lower[1:] + upper[1:]) / 2",
                f"self.radii, w = (lower[0], upper[0]), (lower[1:] + upper[1:]) {half}",
            )
            for half in ("/ 1", "/ 4", "* 2")
        ),
    },
    EMPTY: {
        "terminal_set/taylor.py": (
            (
                "return np.where(kinks | cuts, np.inf, "
                "added_up(0 * d[0], third * d / 6))",
                "return np.where(kinks | cuts, np.inf, "
                "added_up(0 * d[1], third * d / 6))",
            ),
        ),
        "ocp/checking.py": (
            (
                "values = ca.vertcat(ca.SX(0, 1), *[r.values for r in rows])",
                "values = ca.vertcat(ca.SX(0, 0), *[r.values for r in rows])",
            ),
            (
                "return np.empty((0, count)), np.empty((0, count), dtype=bool)",
                "return np.empty((0, count)), np.empty((1, count), dtype=bool)",
            ),
        ),
    },
}
"""Reason -> file -> (line, line with the one fault that is harmless)."""

HARMLESS: tuple[tuple[str, str, str, str], ...] = (
    *(
        (file, line, "*", reason)
        for reason, files in _ANY.items()
        for file, lines in files.items()
        for line in lines
    ),
    *(
        (file, before, after, reason)
        for reason, files in _ONE.items()
        for file, pairs in files.items()
        for before, after in pairs
    ),
)
"""File, line, line with the fault or "*" for any, and why it does no harm."""
