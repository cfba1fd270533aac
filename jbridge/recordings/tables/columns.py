"""How a column of a file becomes a channel in SI units: `channel = sign * (raw - offset)`."""

import json
import re
import unicodedata
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from math import pi
from types import MappingProxyType

import numpy as np

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
ANGLES = {"rad": 1.0, "deg": pi / 180, "mrad": 1e-3}
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "day": 86400.0}
OF_EXPORTS = {"min", "h", "day"}
"""Times in which spreadsheets count and no log does."""
INPUT_UNITS = {"V": 1.0, "mV": 1e-3, "A": 1.0, "mA": 1e-3, "%": 1.0, "count": 1.0, "N": 1.0, "N m": 1.0}
GAINS = {"u_x": "cart_gain", "u_l": "hoist_gain"}
"""The parameter that turns an input into a force."""
BASE_UNITS = {"mV": "V", "mA": "A"}
"""The unit that an input is kept in, where it is not the declared one."""

UNITS = {"t": TIMES, "u_x": INPUT_UNITS, "u_l": INPUT_UNITS, "x": LENGTHS, "psi": ANGLES, "l": LENGTHS}
"""Per channel: its units, each with its size in SI; the first is the one that an undeclared column has."""
CHANNELS = tuple(UNITS)
SPELLINGS = {
    "seconds": "s", "sec": "s", "millis": "ms", "msec": "ms", "micros": "us", "usec": "us", "µs": "us", "μs": "us",
    "nanos": "ns", "nsec": "ns", "minutes": "min", "hours": "h", "days": "day", "volts": "V", "volt": "V", "v": "V",
    "a": "A", "ma": "mA", "mv": "mV", "nm": "N m", "counts": "count", "metres": "m", "meters": "m", "degrees": "deg",
    "degree": "deg", "°": "deg", "radians": "rad", "percent": "%", "pwm": "count",
}  # fmt: skip
"""Units as names of columns spell them."""
NEAR = {
    "t": (
        "t", "time", "tout", "timestamp", "zeit", "clock", "seconds", "sec", "millis", "micros", "tiempo", "tijd",
        "tid",
    ),
    "u_x": (
        "ux", "u", "ucart", "utrolley", "umotor", "input", "voltage", "command", "control", "motor", "motorvoltage",
        "cartvoltage", "v", "volt", "volts", "uin", "spannung", "entrada", "voltaje", "entree", "commande", "tensione",
        "ingresso", "tensao", "spanning", "xvolt", "xvoltage",
    ),
    "u_l": ("ul", "uhoist", "uwinch", "hoistvoltage", "winchvoltage", "hoistinput", "hoistmotor"),
    "x": (
        "x", "pos", "position", "cart", "cartpos", "cartposition", "xcart", "poscart", "xpos", "posx", "trolley",
        "trolleypos", "trolleyposition", "xtrolley", "wagen", "wagenposition", "katze", "laufkatze", "posicion",
        "carro", "carrito", "chariot", "posizione", "carrello", "posicao", "carrinho", "positie",
    ),
    "psi": (
        "psi", "theta", "angle", "phi", "alpha", "swing", "swingangle", "pendulumangle", "pendulum", "winkel", "th",
        "pendelwinkel", "angulo", "angolo", "hoek", "vinkel", "pendulo", "pendolo", "ψ", "θ", "φ", "α",
    ),
    "l": (
        "l", "length", "rope", "ropelength", "cable", "cablelength", "len", "lrope", "hoistlength", "seil", "seillange",
        "longitud", "longueur", "lunghezza", "comprimento", "lengte",
    ),
}  # fmt: skip
"""What others call a channel, in small letters without accents and without anything in between."""
CURRENTS = {
    "u_x": (
        "current", "motorcurrent", "cartcurrent", "trolleycurrent", "imotor", "strom", "motorstrom", "corriente",
        "corrente", "courant", "stroom",
    ),
    "u_l": ("hoistcurrent", "winchcurrent"),
}  # fmt: skip
"""What they call a drive's current, which is its input where nothing else is logged that may be."""
COMPUTED = re.compile("pwm|duty|cycle")
"""What says of an input's name that it is in the counts of the program that computes it."""
COMPUTED_FOR = {"u_x": ("", "x", "cart", "trolley", "output"), "u_l": ("l", "hoist", "winch")}
"""What may stand beside that, besides what the input is called otherwise."""
MEASURED_AS = {"meas", "measured", "act", "actual", "ist", "raw", "enc", "encoder", "sensor"}
"""Words that say of a channel's name that it is measured."""
RAW = {"raw"}
"""Words among them that say that it is in the sensor's counts."""
_BY_LENGTH = ((20.0, "cm"), (200.0, "mm"), (2e4, "um"))
UNITS_BY_SIZE = {"psi": ((6.3, "deg"),), "x": _BY_LENGTH, "l": _BY_LENGTH}
"""Numbers of a channel from which on they are rather in another unit than the first one: few loads turn over, and no
laboratory is 20 m long."""
OTHER = {
    "ref",
    "reference",
    "set",
    "setpoint",
    "target",
    "desired",
    "des",
    "dot",
    "vel",
    "velocity",
    "rate",
    "speed",
    "acc",
}
"""Words that make of a channel's name the name of something else."""


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
    radius: float | None = None
    """Of the pulley or drum on which a torque acts [m], for an input in N m."""
    late: int = 0
    """Rows by which an input is logged too late: what acts from a row on stands that many rows below it."""

    def convert(self, raw: np.ndarray, channel: str) -> np.ndarray:
        """Returns the channel in SI units (inputs: in `input_unit`), each value in the row from which on it acts.

        The last value is that of the rows below it, too, and the first one that of the rows above it.
        """
        if self.late:
            raw = raw[self.logged_in(np.arange(raw.size), raw.size)]
        size = self.size(channel)
        if (self.sign, self.offset, size) == (1.0, 0.0, 1.0):
            return raw
        with np.errstate(over="ignore"):  # what overflows is found, and refused, as infinite
            # 410 ms are 0.41 s to the last bit.
            whole = round(1.0 / size) if 1e-9 < size < 1.0 else 1
            if whole * size == 1.0:
                return self.sign * ((raw - self.offset) / whole)
            return self.sign * size * (raw - self.offset)

    def size(self, channel: str) -> float:
        """Returns the size of one of its readings in SI units, for a channel."""
        return UNITS[channel][self.unit] if self.scale is None else self.scale

    def zeroed(self, channel: str, value: float) -> "Column":
        """Returns the column with its zero where a value is read now, in SI units."""
        return replace(self, offset=float(f"{self.offset + self.sign * value / self.size(channel):.3g}"))

    def logged_in(self, rows: np.ndarray, count: int) -> np.ndarray:
        """Returns the rows, of so many, in which the file has what acts from the given rows on."""
        return np.clip(rows + self.late, 0, count - 1)

    def line(self, channel: str) -> str:
        """Returns the line of `[columns]` that declares it for a channel, with `...` for what is open."""
        parts = [f"column = {json.dumps(self.name, ensure_ascii=False)}", f'unit = "{self.unit}"']
        parts += ["sign = -1"] if self.sign < 0 else []
        # Six digits tell a reading, but neither a time of day nor the middle of a counter of many bits.
        digits = ".6g" if channel != "t" and abs(self.offset) < 1e5 else ".16g"
        parts += [f"offset = {self.offset:{digits}}"] if self.offset else []
        counted = self.unit == "count" and channel not in GAINS
        parts += [f"scale = {self.scale:g}"] if self.scale is not None else ["scale = ..."] if counted else []
        parts += [f"radius = {self.radius:g}"] if self.radius is not None else []
        parts += [f"late = {self.late}"] if self.late else []
        return f"{channel} = {{{', '.join(parts)}}}"

    @property
    def input_unit(self) -> str:
        """The unit that an input is kept in: gains, dead zones and reports carry it."""
        return BASE_UNITS.get(self.unit, self.unit)

    @property
    def gain(self) -> float | None:
        """Force per unit of an input that is a force, or a torque on a known radius; None where a fit must tell it."""
        if self.unit == "N":
            return 1.0
        return None if self.radius is None else 1.0 / self.radius


def plain_column(channel: str) -> Column:
    """Returns the column that a channel has where no sidecar says otherwise: its own name, in SI units."""
    return Column(channel, next(iter(UNITS[channel])))


def labelled_columns(channel: str, names: Iterable[str]) -> list[Column]:
    """Returns the columns whose name is a channel's and a unit, which says all that a declaration would.

    >>> labelled_columns("x", ["t [s]", "x [mm]"])
    [Column(name='x [mm]', unit='mm', sign=1.0, offset=0.0, scale=None, radius=None, late=0)]
    """
    found = []
    for name in names:
        match = re.fullmatch(rf"{channel}\s*(?:\[(.+)\]|\((.+)\)|/\s*(.+))", name.strip())
        if match:
            unit = spelled(next(filter(None, match.groups())), channel)
            if unit and (unit != "count" or channel in GAINS):
                found.append(Column(name, unit))
    return found


def spelled(unit: str, channel: str) -> str:
    """Returns a unit of a channel as `UNITS` has it; nothing where the channel has no such unit."""
    unit = unit.strip()
    unit = unit if unit in UNITS[channel] else SPELLINGS.get(unit.lower(), unit.lower())
    return unit if unit in UNITS[channel] else ""


def unit_in(name: str, channel: str) -> tuple[str, list[str]]:
    """Returns the unit with which a column's name ends, in brackets or as a word, and the words before it.

    Words are in small letters without accents. A name that is a unit alone is a word, too.

    >>> unit_in("Tiempo [min]", "t"), unit_in("Länge_mm", "l")
    (('min', ['tiempo']), ('mm', ['lange']))
    """
    bracket = re.search(r"[\[(]([^][()]+)[\])]\s*$", name)
    if bracket and spelled(bracket[1], channel):
        return spelled(bracket[1], channel), words_in(name[: bracket.start()])
    words = words_in(name)
    unit = spelled(words[-1], channel) if words else ""
    return unit, words[:-1] if unit and len(words) > 1 else words


def words_in(name: str) -> list[str]:
    """Returns the words of a name, in small letters without accents."""
    letters = unicodedata.normalize("NFD", name.replace("m/s", "velocity").lower())
    return re.findall(r"[^\W\d_]+|%|°", "".join(each for each in letters if not unicodedata.combining(each)))


def near_column(
    channel: str,
    names: Iterable[str],
    told: Mapping[str, str] = MappingProxyType({}),
    sizes: Mapping[str, float] = MappingProxyType({}),
) -> Column | None:
    """Returns a column that is probably meant for a channel by its name, with the unit that the name gives.

    A name that is the channel's comes before one that says besides how it is measured, then come raw readings, which
    are counts unless a unit is given, slips of the keyboard, and a drive's current for its input.

    Args:
        channel: that is missing.
        names: of the columns.
        told: units that the file gives elsewhere, by the name of the column.
        sizes: largest numbers of the columns. What is large for the channel's usual unit is offered in another one,
            unless the file says more.

    >>> near_column("psi", ["t", "x_ref", "angle_raw", "Theta (deg)"])
    Column(name='Theta (deg)', unit='deg', sign=1.0, offset=0.0, scale=None, radius=None, late=0)
    """
    found: list[tuple[int, Column]] = []
    for name in names:
        unit, whole = unit_in(name, channel)
        if not whole or not OTHER.isdisjoint(whole):
            continue
        known, measured = NEAR[channel], not channel.startswith("u_")
        bare = [word for word in whole if word not in MEASURED_AS] or whole if measured else whole
        raw = measured and not RAW.isdisjoint(whole)
        current = "".join(word for word in whole if word not in MEASURED_AS) in CURRENTS.get(channel, ())
        computed = not measured and bool({"pwm", "duty"}.intersection(COMPUTED.findall(name.lower())))
        drive = COMPUTED.sub("", "".join(whole))
        if "".join(whole) in known or (computed and drive in (*known, *COMPUTED_FOR[channel])):
            rank = 0
        elif "".join(bare) in known:
            rank = 2 if raw else 1
        elif get_close_matches("".join(bare), [word for word in known if len(word) > 4], 1, 0.83):
            rank = 3  # a slip of the keyboard in a word of five letters or more
        elif current:
            rank = 4
        else:
            continue
        if not unit:
            larger = [unit for least, unit in UNITS_BY_SIZE.get(channel, ()) if sizes.get(name, 0.0) > least]
            usual = (larger or [plain_column(channel).unit])[-1]
            unit = spelled(told.get(name, ""), channel) or ("count" if raw or computed else "A" if current else usual)
        found.append((rank, Column(name, unit)))
    return min(found, key=lambda each: each[0], default=(0, None))[1]
