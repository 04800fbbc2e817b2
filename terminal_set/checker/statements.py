"""The statements of a certificate, in the only accepted words.

The checker judges exactly these. Free text labelled "proven" would look as if it had
been checked.
"""

from __future__ import annotations

_PROVEN, _CLOSED_FORM, _MEASURED = "proven", "closed form", "measured"
TAKEN = "proven by the library"  # Not proven again: the checker only samples it.


def expected_statements(
    *, held: bool, integrator_proven: bool, growth_proven: bool
) -> dict[str, str]:
    """Return the statements of a certificate, with their grounds.

    Args:
        held: Whether inputs are held.
        integrator_proven: Whether the integrator's error is labelled proven by the
            library.
        growth_proven: Whether the growth between samples is labelled proven.

    Returns:
        Statement -> grounds.
    """
    falls = "e'Pe falls by more than e'Q_m e"
    outside = " outside the stated core, which is not left"
    inputs = "the inputs stay within their bounds on the set"
    states = "the states stay within their bounds on the set"
    if not held:
        return {
            inputs: _CLOSED_FORM,
            states: _CLOSED_FORM,
            f"{falls} a second{outside}": _PROVEN,
        }
    return {
        inputs: _CLOSED_FORM,
        f"{states}, between samples too": (
            TAKEN if integrator_proven and growth_proven else _MEASURED
        ),
        f"{falls} a hold{outside}, for the Runge-Kutta map and any motion that "
        "differs from it by the stated error": _PROVEN,
        "the integrator's error is at most the stated one": (
            TAKEN if integrator_proven else _MEASURED
        ),
        "e'Pe stays below the stated growth between samples": (
            _PROVEN if growth_proven else _MEASURED
        ),
    }
