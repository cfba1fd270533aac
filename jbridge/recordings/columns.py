"""How a column of a file becomes a channel in SI units: `channel = sign * (raw - offset)`."""

from dataclasses import dataclass
from math import pi

import numpy as np

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
ANGLES = {"rad": 1.0, "deg": pi / 180, "mrad": 1e-3}
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
INPUT_UNITS = {"V": 1.0, "mV": 1e-3, "A": 1.0, "mA": 1e-3, "%": 1.0, "count": 1.0}
BASE_UNITS = {"mV": "V", "mA": "A"}
"""The unit that an input is kept in, where it is not the declared one."""

UNITS = {"t": TIMES, "u_x": INPUT_UNITS, "u_l": INPUT_UNITS, "x": LENGTHS, "psi": ANGLES, "l": LENGTHS}
"""Per channel: its units, each with its size in SI; the first is the one that an undeclared column has."""
CHANNELS = tuple(UNITS)


@dataclass(frozen=True)
class Column:
    """A column of a file and how to read it."""

    name: str
    """Its name in the file."""
    unit: str
    """Its unit; an encoder's count (`count`) needs a `scale`."""
    sign: float = 1.0
    """-1 where the sensor counts the other way."""
    offset: float = 0.0
    """Reading at the channel's zero, in the column's unit."""
    scale: float | None = None
    """Size of one count [m, rad or s], for a measured channel in counts."""

    def convert(self, raw: np.ndarray, channel: str) -> np.ndarray:
        """Returns the channel in SI units (inputs: in `input_unit`)."""
        size = UNITS[channel][self.unit] if self.scale is None else self.scale
        if (self.sign, self.offset, size) == (1.0, 0.0, 1.0):
            return raw
        with np.errstate(over="ignore"):  # what overflows is found, and refused, as infinite
            return self.sign * size * (raw - self.offset)

    @property
    def input_unit(self) -> str:
        """The unit that an input is kept in: gains, dead zones and reports carry it."""
        return BASE_UNITS.get(self.unit, self.unit)


def plain_column(channel: str) -> Column:
    """Returns the column that a channel has where no sidecar says otherwise: its own name, in SI units."""
    return Column(channel, next(iter(UNITS[channel])))
