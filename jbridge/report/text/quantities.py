"""Numbers with units as people read them: degrees, millimetres where lengths are small, digits that mean something.

Nothing here feeds a file that a program reads; those stay in SI.
"""

import dataclasses
import math
import re
from collections.abc import Iterable

from ...identification.result import Estimate

_DEGREES = 180.0 / math.pi
_ANGLES = {"rad": "°", "rad/s": "°/s"}
_SMALL = {"m": "mm", "m/s": "mm/s", "s": "ms"}
_SMALL_BELOW = 0.1
"""A quantity is shown in thousandths if all its numbers are smaller than this [m, m/s, s]."""
_ERRORS = {"x": ("mm", 1e3), "psi": ("°", _DEGREES), "l": ("mm", 1e3)}
UNKNOWN = "–"


@dataclasses.dataclass(frozen=True)
class Scale:
    """How a quantity is shown: `shown = factor * SI`, in `unit`."""

    factor: float
    unit: str


def scale_for(unit: str, values: Iterable[float | None]) -> Scale:
    """Chooses what a quantity in an SI unit is shown in, by its unit and its numbers.

    >>> scale_for("m", [0.012, -0.05])
    Scale(factor=1000.0, unit='mm')
    >>> scale_for("N s/m", [45.0])
    Scale(factor=1.0, unit='N s/m')
    """
    if unit in _ANGLES:
        return Scale(_DEGREES, _ANGLES[unit])
    sizes = [abs(value) for value in values if value is not None and math.isfinite(value)]
    if unit in _SMALL and sizes and 0.0 < max(sizes) < _SMALL_BELOW:
        return Scale(1e3, _SMALL[unit])
    return Scale(1.0, pretty_unit(unit))


def pretty_unit(unit: str) -> str:
    """A unit in print.

    >>> pretty_unit("N s^2/m^2"), pretty_unit("1")
    ('N s²/m²', '')
    """
    return "" if unit == "1" else unit.replace("^2", "²").replace("^3", "³")


def error_scale(channel: str) -> Scale:
    """Unit of a channel's errors: millimetres and degrees."""
    unit, factor = _ERRORS[channel]
    return Scale(factor, unit)


def join_unit(number: str, unit: str) -> str:
    """A number and its unit; a degree or percent sign follows without a space, as is the custom.

    >>> join_unit("1.5", "mm"), join_unit("1.5", "°/s"), join_unit("2", "")
    ('1.5 mm', '1.5°/s', '2')
    """
    return f"{number}{'' if not unit or unit[0] in '°%' else ' '}{unit}"


def digits(value: float | None, count: int = 3) -> str:
    """A number with `count` significant digits, without an exponent where it can be read without one.

    >>> digits(0.0012345), digits(1234.5), digits(12.0), digits(3.2e-7), digits(None)
    ('0.00123', '1234', '12.0', '3.2e-07', '–')
    """
    if value is None or not math.isfinite(value):
        return UNKNOWN
    if value == 0.0:
        return "0"
    size = math.floor(math.log10(abs(value)))
    if not -5 <= size < 6:
        return f"{value:.{count}g}"
    return f"{value:.{max(count - 1 - size, 0)}f}"


def plain(value: float, count: int = 2) -> str:
    """A measured number as a person writes it: without an exponent, and 0 where nothing would be measured.

    >>> plain(-1.04e4), plain(2512.0), plain(0.0031), plain(5.71e-18)
    ('-10400', '2512', '0.0031', '0')
    """
    return digits(value, count) if 1e-4 <= abs(value) < 1e6 else f"{value + 0.0:.0f}"


def unbroken(text: str) -> str:
    """A text in which no line ends between a number and its unit.

    >>> unbroken("closes 99 % of 3 mm").replace("\u00a0", "~")
    'closes 99~% of 3~mm'
    """
    return re.sub(r"(?<=\d) (?=(?:%|×|°|[munk]?[msNVA]|rad|mrad)\b|%|×)", "\u00a0", text)


def percent(share: float | None) -> str:
    """A share as a percentage that does not round to a certainty that is not there.

    >>> percent(0.934), percent(0.9999), percent(0.002), percent(1.0), percent(None)
    ('93 %', '> 99 %', '< 1 %', '100 %', '–')
    """
    if share is None or not math.isfinite(share):
        return UNKNOWN
    if 0.99 < share < 1.0:
        return "> 99 %"
    if 0.0 < share < 0.01:
        return "< 1 %"
    return f"{100 * share:.0f} %"


def times_noise(error: float | None, noise: float | None) -> str:
    """An error as a multiple of the noise.

    >>> times_noise(12e-3, 1e-4)
    '120 × noise'
    """
    if error is None or not noise or not math.isfinite(error / noise):
        return UNKNOWN
    return f"{digits(error / noise, 2)} × noise"


@dataclasses.dataclass(frozen=True)
class Shown:
    """A parameter ready for a table."""

    value: str
    interval: str
    unit: str

    @property
    def text(self) -> str:
        """Value with unit, and the interval behind it if there is one."""
        behind = "" if self.interval == UNKNOWN else f" (95 %: {self.interval})"
        return join_unit(self.value, self.unit) + behind


def shown(estimate: Estimate) -> Shown:
    """An estimate with as many digits as its uncertainty justifies; a vector without its intervals, for lack of room.

    >>> shown(Estimate(0.3012, 0.011, 0.2801, 0.3224, "V")).text
    '0.301 V (95 %: 0.280 to 0.322)'
    >>> shown(Estimate([1.0, 2.0], None, None, None, "N")).text
    '1, 2 N'
    """
    each = shown_entries(estimate)
    if len(each) == 1:
        return each[0]
    return Shown(", ".join(entry.value for entry in each), UNKNOWN, each[0].unit if each else "")


def shown_entries(estimate: Estimate) -> list[Shown]:
    """The entries of a vector (a scalar is a vector of one), all in one unit and with the same digits."""
    values, stds = as_list(estimate.value), as_list(estimate.std)
    lows, highs = _padded(estimate.low, len(values)), _padded(estimate.high, len(values))
    scale = scale_for(estimate.unit, [*values, *lows, *highs])
    known = [std for std in stds if std is not None and 0 < std < math.inf]
    finest = min(known) * scale.factor if known else None
    if finest is not None and len(values) > 1:
        # A curve keeps its shape even where nothing but its shape is determined.
        largest = max((abs(value) for value in values if value is not None), default=0.0) * scale.factor
        finest = min(finest, 0.1 * largest) if largest > 0 else finest

    def text(number: float | None) -> str:
        if number is None or not math.isfinite(number):
            return UNKNOWN
        return _rounded(number * scale.factor, finest)

    entries = []
    for value, low, high in zip(values, map(text, lows), map(text, highs), strict=True):
        interval = UNKNOWN if UNKNOWN in (low, high) else f"{low} to {high}"
        entries.append(Shown(text(value), interval, scale.unit))
    return entries


def _padded(value: float | list[float] | None, size: int) -> list[float | None]:
    numbers = as_list(value)
    return numbers if len(numbers) == size else [None] * size


def as_list(value: float | list[float] | None) -> list[float | None]:
    """A scalar, a vector or nothing as a list."""
    if value is None:
        return []
    return list(value) if isinstance(value, list) else [value]


def _rounded(value: float | None, std: float | None) -> str:
    """A number to two digits of its standard deviation, or to four digits where that is not known."""
    if value is None or not math.isfinite(value):
        return UNKNOWN
    if std is None:
        return f"{value:.4g}"
    places = 1 - math.floor(math.log10(std))
    if places > 7 or abs(value) >= 1e6:
        return f"{value:.4g}"
    return f"{value:.{max(places, 0)}f}"
