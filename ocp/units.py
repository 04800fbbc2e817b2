"""Powers of two taken out of an expression, so that they round nothing.

A cost times a power of two is the same numbers with other exponents. But 2^k (a b) + c
is not rounded as a b + c is: sums are fused with products, and derivatives add up in
another order. With the power taken out of the expression, and multiplied where all is
done, every answer has the same bits.
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
        for factor, other in _both_ways(expression):
            if factor.is_constant() and float(factor) and math.isfinite(float(factor)):
                mantissa, exponent = math.frexp(float(factor))
                inner, rest = without_power_of_two(other)
                left = 2 * mantissa  # In [1, 2), with its sign.
                return inner + exponent - 1, rest if left == 1.0 else left * rest
    if operation == ca.OP_TWICE:
        inner, rest = without_power_of_two(expression.dep(0))
        return inner + 1, rest
    if operation == ca.OP_NEG:
        inner, rest = without_power_of_two(expression.dep(0))
        return inner, -rest
    if operation in (ca.OP_ADD, ca.OP_SUB):
        (k, a), (m, b) = (without_power_of_two(expression.dep(i)) for i in (0, 1))
        if k == m and k:
            return k, a + b if operation == ca.OP_ADD else a - b
    return 0, expression


def _both_ways(product: ca.SX) -> tuple[tuple[ca.SX, ca.SX], tuple[ca.SX, ca.SX]]:
    first, second = product.dep(0), product.dep(1)
    return (first, second), (second, first)
