"""Binary sequences and polynomials, computed in other ways than excite does."""

import numpy as np


def circular_correlation(a, b):
    """sum_k a(k) b(k + l) for all l."""
    return np.fft.ifft(np.conj(np.fft.fft(a)) * np.fft.fft(b)).real


def prime_factors(number):
    factors, divisor = set(), 2
    while divisor * divisor <= number:
        while number % divisor == 0:
            factors.add(divisor)
            number //= divisor
        divisor += 1
    return factors | ({number} if number > 1 else set())


def power_of_x(exponent, polynomial, degree):
    """x^exponent modulo a polynomial over GF(2), both as bit masks."""

    def product(a, b):
        result = 0
        while b:
            if b & 1:
                result ^= a
            a, b = a << 1, b >> 1
            if a >> degree & 1:
                a ^= polynomial
        return result

    result, base = 1, 2
    while exponent:
        if exponent & 1:
            result = product(result, base)
        base, exponent = product(base, base), exponent >> 1
    return result


def is_primitive(order, taps):
    """Whether x has the order 2^n - 1 modulo the feedback polynomial over GF(2): the definition."""
    polynomial = 1 << order | 1 | sum(1 << tap for tap in taps)
    length = 2**order - 1
    return power_of_x(length, polynomial, order) == 1 and all(
        power_of_x(length // q, polynomial, order) != 1 for q in prime_factors(length)
    )
