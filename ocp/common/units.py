"""Powers of two factored out of an expression, so that they cause no rounding.

A cost times a power of two has the same digits with other exponents. But 2^k (a b) + c
is not rounded like a b + c: sums are fused with products, and derivatives add up in
another order. If the power is factored out of the expression and applied at the very
end, every answer has the same bits.
"""

import math

import casadi as ca


def without_power_of_two(expression: ca.SX) -> tuple[int, ca.SX]:
    """Return (k, rest) with expression = 2^k rest, k taken from constant factors.

    Args:
        expression: A scalar.
    """
    if expression.is_constant() or not expression.nnz():
        return 0, expression
    operation = expression.op()
    if operation == ca.OP_MUL:
        return _of_product(expression)
    if operation == ca.OP_TWICE:
        power, rest = without_power_of_two(expression.dep(0))
        return power + 1, rest
    if operation == ca.OP_NEG:
        power, rest = without_power_of_two(expression.dep(0))
        return power, -rest
    if operation in (ca.OP_ADD, ca.OP_SUB):
        return _of_sum(expression)
    return 0, expression


def _of_product(product: ca.SX) -> tuple[int, ca.SX]:
    first, second = product.dep(0), product.dep(1)
    for factor, other in ((first, second), (second, first)):
        if factor.is_constant() and float(factor) and math.isfinite(float(factor)):
            mantissa, exponent = math.frexp(float(factor))
            power, rest = without_power_of_two(other)
            left = 2 * mantissa  # In [1, 2), with its sign.
            return power + exponent - 1, rest if left == 1.0 else left * rest
    return 0, product


def _of_sum(total: ca.SX) -> tuple[int, ca.SX]:
    """Return the power that both terms share, taken out of a sum or difference."""
    (k, a), (m, b) = (without_power_of_two(total.dep(i)) for i in (0, 1))
    if k != m or not k:
        return 0, total
    return k, a + b if total.op() == ca.OP_ADD else a - b
