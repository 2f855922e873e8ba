"""Units of columns: their values in SI, and their place in a heading."""

import math
import re
from typing import Any, NamedTuple

#: Standard gravity (m/s^2), the "g" of accelerometers.
G0 = 9.80665

# Units that take a prefix, and those that take none: factor, and SI factors with their exponents.
_PREFIXED: dict[str, tuple[float, dict[str, int]]] = {
    **{unit: (1.0, {unit: 1}) for unit in ("s", "m", "rad", "N", "A", "V", "C", "F", "Pa", "Hz", "W", "J", "K", "Ω")},
    "deg": (math.pi / 180, {"rad": 1}),
    "g": (G0, {"m": 1, "s": -2}),
    "Nm": (1.0, {"N": 1, "m": 1}),
    "ohm": (1.0, {"Ω": 1}),
    "bar": (1e5, {"Pa": 1}),
    "strain": (1.0, {}),
    "ε": (1.0, {}),
}
_ALONE: dict[str, tuple[float, dict[str, int]]] = {
    "1": (1.0, {}),
    "%": (0.01, {}),
    "kg": (1.0, {"kg": 1}),
    "gram": (1e-3, {"kg": 1}),
    **{word: (1.0, {si: 1}) for si, words in {"s": "sec second seconds", "rad": "radian radians", "A": "amp amps",
       "m": "meter meters metre metres", "V": "volt volts"}.items() for word in words.split()},
    "min": (60.0, {"s": 1}),
    "h": (3600.0, {"s": 1}),
    "°": (math.pi / 180, {"rad": 1}),
    "degree": (math.pi / 180, {"rad": 1}),
    "degrees": (math.pi / 180, {"rad": 1}),
    "rev": (2 * math.pi, {"rad": 1}),
    "rpm": (math.pi / 30, {"rad": 1, "s": -1}),
    "dps": (math.pi / 180, {"rad": 1, "s": -1}),
    "Nmm": (1e-3, {"N": 1, "m": 1}),
    "in": (0.0254, {"m": 1}),
    "lbf": (4.4482216152605, {"N": 1}),
}
_PREFIXES = {"p": 1e-12, "n": 1e-9, "u": 1e-6, "µ": 1e-6, "μ": 1e-6, "m": 1e-3, "c": 1e-2, "k": 1e3, "M": 1e6, "G": 1e9}
_CELSIUS = ("°C", "degC", "Celsius")
_POWERS = str.maketrans("⁻⁰¹²³⁴", "-01234")
_SPEED = re.compile(r"(?:^|_)v(?:[xyz]|el|eloc\w*)?\d*(?:_|$)|speed", re.IGNORECASE)  # whose "_ms" is m/s
_SIMPLE = "s ms us m mm um cm rad mrad deg rpm dps A mA uA V mV N mN kN Nm mNm Nmm Hz kHz kg Pa kPa MPa".split()


class Unit(NamedTuple):
    """A unit in SI: value times `scale` plus `shift` is in the unit `si`."""

    si: str
    scale: float = 1.0
    shift: float = 0.0


KNOWN = (
    "s rad m kg N Pa A V C F W J K Hz Ω deg g (gravity) Nm strain with a prefix (p n u µ m c k M G) or none; "
    "1 % min h ° rev rpm dps gram in lbf °C; products and powers of them such as deg/s, N mm, mm/s^2"
)


def unit(text: str) -> Unit:
    """A unit in SI: "deg/s" -> rad/s, "mm/s^2" -> m/s^2, "N·mm" -> N m, "g" -> m/s^2, "uA" -> A. An empty one
    is not known, and counts as SI.

    Raises:
        ValueError: an unknown unit.
    """
    bare = text.strip()
    if not bare:
        return Unit("")
    if bare in _CELSIUS:
        return Unit("K", 1.0, 273.15)
    scale, powers, sign, below = 1.0, dict[str, int](), 1, 0
    for part in re.split(r"([/·*\s]+|(?<=\w)\s*per\s+)", _marked(bare)):
        mark = part.strip()
        if not mark or set(mark) <= set("·* "):
            continue
        if mark in ("/", "per"):
            if sign < 0:
                raise _unknown(text)
            sign = -1
            continue
        factor, of, power = _factor(mark, text)
        below += sign < 0
        scale *= factor ** (sign * power)
        for name, n in of.items():
            powers[name] = powers.get(name, 0) + sign * power * n
    if below > 1 and "(" not in bare:  # "N/m s" may be either
        raise _unknown(text)
    return Unit(_written(powers), scale)


def _marked(text: str) -> str:
    """Powers as "^", products as "·", without brackets about divisors."""
    text = re.sub(r"[⁻⁰¹²³⁴]+", lambda m: "^" + m[0].translate(_POWERS), text.replace("**", "^").replace("⋅", "·"))
    return re.sub(r"\(([^()/]*)\)$", r"\1", text.replace("\\", ""))


def _factor(part: str, whole: str) -> tuple[float, dict[str, int], int]:
    """Factor, SI units and power of "mm^2" and the like."""
    split = re.fullmatch(r"(.*?[^\d^-])(?:\^?(-?\d))?", part) or re.fullmatch(r"(1)()", part)
    if split is None:
        raise _unknown(whole)
    name, power = split[1], int(split[2] or 1)
    if name in _ALONE:
        return *_ALONE[name], power
    if name in _PREFIXED:
        return *_PREFIXED[name], power
    prefix, base = name[:1], name[1:]
    if prefix in _PREFIXES and base in _PREFIXED:
        factor, of = _PREFIXED[base]
        return _PREFIXES[prefix] * factor, of, power
    raise _unknown(whole)


def _unknown(text: str) -> ValueError:
    return ValueError(f"unknown unit '{text}'; known are {KNOWN}")


def _written(powers: dict[str, int]) -> str:
    above = " ".join(name if n == 1 else f"{name}^{n}" for name, n in powers.items() if n > 0)
    below = [name if n == -1 else f"{name}^{-n}" for name, n in powers.items() if n < 0]
    return (above or "1") + ("/" if below else "") + (f"({' '.join(below)})" if len(below) > 1 else "".join(below))


def heading(text: str) -> tuple[str, str]:
    """Name and unit of a column's heading: "theta [deg]", "theta (deg)", or "theta_deg", "rate_deg_s", where the
    part after the last underscore is a common unit; "speed_ms" and "a_ms2" are in m/s and m/s2. A unit in
    brackets may be one that is not known."""
    bare = text.strip()
    found = re.fullmatch(r"(.*\S)\s*(?:\[([^\[\]]*)\]|\(((?:[^()]|\([^()]*\))*)\))", bare)
    if found:
        return found[1], (found[2] if found[2] is not None else found[3]).strip()
    parts = bare.split("_")
    if len(parts) > 2 and parts[-1] in ("s", "s2") and parts[-2] in _SIMPLE:
        return "_".join(parts[:-2]), f"{parts[-2]}/{parts[-1]}"
    if len(parts) > 1 and all(parts[:-1]) and (parts[-1] == "ms2" or (parts[-1] == "ms" and _SPEED.search(bare[:-3]))):
        return "_".join(parts[:-1]), parts[-1].replace("m", "m/")
    if len(parts) > 1 and parts[-1] in _SIMPLE and all(parts[:-1]):
        return "_".join(parts[:-1]), parts[-1]
    return bare, ""


def titled(name: str, si: str) -> str:
    """The heading of a column in SI, which `heading` reads."""
    text = f"{name} ({si})"
    return name if not si and heading(name) == (name, "") else text


def unit_of(name: str, text: Any) -> Unit:
    """The unit of a column; ValueError that names both."""
    if not isinstance(text, str):
        raise ValueError(f"units['{name}'] = {text!r}: must be text, such as 'deg'")
    try:
        return unit(text)
    except ValueError as e:
        raise ValueError(f"column '{name}': {e}") from None
