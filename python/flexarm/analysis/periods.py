"""The time after which the samples of several rates repeat."""

from __future__ import annotations

from fractions import Fraction
from math import gcd, lcm

_MOST = 1000  # samples in a common period
SAME = 1e-9  # parts of a period by which times are the same


def common_period(rates: dict[str, float]) -> float:
    """The shortest time (s) in which all of some rates (Hz) have a whole number of samples.

    Raises:
        ValueError: there is none with up to 1000 samples.
    """
    fastest = max(rates.values())
    parts = [Fraction(rate / fastest).limit_denominator(_MOST) for rate in rates.values()]
    if all(abs(float(x) * fastest - rate) <= SAME * rate for x, rate in zip(parts, rates.values(), strict=True)):
        common = Fraction(gcd(*(x.numerator for x in parts)), lcm(*(x.denominator for x in parts)))
        if 1 / common <= _MOST:
            return float(1 / common) / fastest
    named = ", ".join(f"{name} = {rate:.10g}" for name, rate in rates.items())
    raise ValueError(
        f"{named} (Hz): have no common period of up to {_MOST} samples; give rates with whole ratios, such as 1000 "
        "and 250"
    )
