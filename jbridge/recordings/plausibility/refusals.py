"""Refusals of channels that are read wrongly, each with the line of a sidecar that mends it."""

from dataclasses import replace

import numpy as np

from jbridge.errors import InputError, cut
from jbridge.recordings.channels import Channels
from jbridge.recordings.tables.columns import BASE_UNITS, UNITS

FORCE = "; --force takes it as it is"
"""What to do if what is doubted is right."""


def times_more(count: int) -> str:
    """Returns how often more something happens than the once that is told; nothing where it does not."""
    return f", and {'once' if count == 1 else f'{count} times'} more" if count else ""


def base_unit(unit: str) -> str:
    """Returns V or A for a unit of voltage or current, so that these are not mixed; nothing for any other unit."""
    return BASE_UNITS.get(unit, unit if unit in BASE_UNITS.values() else "")


def refusal(
    channels: Channels, channel: str, what: str, *, factor: float = 1.0, turned: bool = False, counts: bool = False
) -> InputError:
    """Returns the refusal of a channel, with the line that declares it otherwise.

    Args:
        channels: of the recording.
        channel: the one to blame.
        what: shows it.
        factor: by which what was read is too small in SI units, where its unit is another one.
        turned: whether the sign is the other one.
        counts: whether what was read is in no unit.
    """
    column = channels.columns[channel]
    sizes = {name: size for name, size in UNITS[channel].items() if base_unit(name) == base_unit(column.unit)}
    if factor != 1 and (counts or column.scale is not None):
        scale = column.size(channel) * factor
        mended = replace(column, unit="count", scale=float(f"{scale:.3g}") if counts else scale)
    elif factor != 1:
        size = sizes[column.unit] * factor
        mended = replace(column, unit=min(sizes, key=lambda name: abs(np.log(sizes[name] / size))))
    else:
        mended = replace(column, sign=-column.sign if turned else column.sign)
    message = f"{what}; declare {mended.line(channel)} under {channels.place(channel)}{FORCE}"
    if factor != 1:
        values = channels.values[channel]
        return channels.error(int(np.abs(values - np.median(values)).argmax()), channel, message)
    return InputError(f"{channels.table.path}, column {cut(column.name)}: {message}")
