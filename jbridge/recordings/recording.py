"""One recording of a rig: what was commanded and what was measured, in SI units."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError

MEASURED = ("x", "psi", "l")
"""Names of the measured channels, those of the axes."""
INPUTS = ("u_x", "u_l")
"""Names of the inputs: of the cart's drive and of the hoist's."""


@dataclass(frozen=True, eq=False)
class Commands:
    """Inputs over some time, without what was measured; its arrays are all of the length of `times`."""

    times: np.ndarray
    """[s], strictly increasing."""
    u_x: np.ndarray | None
    u_l: np.ndarray | None


@dataclass(frozen=True, eq=False, kw_only=True)
class Recording:
    """Inputs and measurements of one run; its arrays are read-only and all of the length of `times`.

    Which channels are absent says which parts the rig has: see `has_cart`, `has_swing` and `has_hoist`.
    """

    name: str
    """File name, such as `train-1.csv`, or what arrays were called."""
    times: np.ndarray
    """Times of the rows [s], strictly increasing, as in the file: not shifted to start at 0."""
    u_x: np.ndarray | None
    """Input of the cart's drive, in `units["u_x"]`, held from one row to the next."""
    u_l: np.ndarray | None
    """Input of the hoist's drive, in `units["u_l"]`; absent where the rope is locked."""
    x: np.ndarray | None
    """Measured cart position [m]."""
    psi: np.ndarray | None
    """Measured swing angle [rad], not wrapped."""
    l: np.ndarray | None
    """Measured rope length [m]; also with a locked rope, since a constant reading may carry an offset."""
    fresh: dict[str, np.ndarray]
    """Per measured channel: True where a row has a new sample, False where a slower sensor repeats one or
    the log lost the row."""
    resolution: dict[str, float]
    """Per measured channel: size of one count [m, rad], declared or estimated; 0 where none can be seen."""
    units: dict[str, str]
    """Unit of each input present: V, A, %, count, N or N m."""
    locked_length: float | None
    """Rope length [m] where a load swings on a locked rope."""
    override: dict[str, float]
    """Parameters of the model that hold for this run alone."""
    initial: dict[str, float]
    """State at the start, as declared for `simulate`: any of x [m], psi [rad], l [m]."""
    extras: dict[str, np.ndarray]
    """Other columns of the file, by name, in the units of the file."""
    notes: tuple[str, ...]
    """What was detected or assumed, each one sentence for the rig's owner."""
    begun: float = 0.0
    """Time [s] before the first row at which the run began, for a piece cut out of one: drift and wind go by it."""
    earlier: Commands | None = None
    """Inputs of the rows before the first one here, which a delay or a lag still feels; None counts as inputs of 0."""

    def __repr__(self) -> str:
        channels = ", ".join(name for name in (*INPUTS, *MEASURED) if getattr(self, name) is not None)
        return f"<Recording {self.name}: {len(self.times)} rows, {self.duration:.4g} s, {channels}>"

    @classmethod
    def from_arrays(  # noqa: PLR0913
        cls,
        *,
        t: ArrayLike,
        u_x: ArrayLike | None = None,
        u_l: ArrayLike | None = None,
        x: ArrayLike | None = None,
        psi: ArrayLike | None = None,
        l: ArrayLike | None = None,
        name: str = "recording",
        sidecar: Mapping[str, Any] | None = None,
        inputs_only: bool = False,
        force: bool = False,
    ) -> "Recording":
        """Returns the recording in arrays of shape `(time,)`, checked and converted like the columns of a file.

        The arrays are copied. What the rig does not have is left out, as in a file.

        Args:
            t: Times of the rows [s].
            u_x, u_l: Inputs of the cart's drive and of the hoist's [V], held from one row to the next.
            x: Cart position [m].
            psi: Swing angle [rad].
            l: Rope length [m].
            name: What reports and refusals call the recording.
            sidecar: The tables of a sidecar, such as `{"locked": {"l": 0.7}, "columns": {"u_x": {"unit": "A"}}}`:
                units, signs and offsets, `hold`, `resolution`, `override`, `trim`, `initial` and `locked`.
            inputs_only: Whether measured channels may be absent, as in the input of a simulation.
            force: Whether to take what is plainly in another unit, of another sign or called otherwise.

        Raises:
            InputError: As for a file: one line with name, row (its index in the arrays), column and what to do.
        """
        from .arrays import recording_from

        given = {"t": t, "u_x": u_x, "u_l": u_l, "x": x, "psi": psi, "l": l}
        columns = {channel: values for channel, values in given.items() if values is not None}
        return recording_from(name, columns, sidecar or {}, inputs_only, force)

    @classmethod
    def from_dataframe(
        cls,
        frame: Any,
        columns: Mapping[str, Any] | None = None,
        *,
        name: str = "recording",
        sidecar: Mapping[str, Any] | None = None,
        inputs_only: bool = False,
        force: bool = False,
    ) -> "Recording":
        """Returns the recording in a data frame (pandas, polars, or a mapping of arrays), checked like a file.

        Args:
            frame: Columns by name. The index of a pandas frame serves as a column, too, if it has a name.
            columns: The column of each channel, as under `[columns]` in a sidecar: its name, or a mapping such as
                `{"column": "theta", "unit": "deg", "sign": -1, "offset": 180}`. A channel that is not named has the
                column of its own name, in SI units.
            name, sidecar, inputs_only, force: As in `from_arrays`.

        Raises:
            InputError: As for a file: one line with name, row (its position in the frame), column and what to do.
        """
        from .arrays import columns_of, recording_from

        declared = dict(sidecar or {})
        if columns:
            declared["columns"] = {**declared.get("columns", {}), **columns}
        return recording_from(name, columns_of(name, frame), declared, inputs_only, force)

    @property
    def start(self) -> float:
        """Time of the first row [s]."""
        return float(self.times[0])

    @property
    def duration(self) -> float:
        """Time from the first row to the last [s]."""
        return float(self.times[-1] - self.times[0])

    @property
    def period(self) -> float:
        """Median time from one row to the next [s]."""
        return float(np.median(np.diff(self.times)))

    def samples(self, channel: str) -> tuple[np.ndarray, np.ndarray]:
        """Returns times [s] and values of the fresh samples of a measured channel."""
        fresh = self.fresh[channel]
        return self.times[fresh], getattr(self, channel)[fresh]

    @property
    def commands(self) -> Commands:
        """Its inputs, those before its first row included."""
        own = Commands(self.times, self.u_x, self.u_l)
        if self.earlier is None:
            return own
        both = (self.earlier, own)

        def joined(name: str) -> np.ndarray | None:
            values = [getattr(part, name) for part in both]
            return None if any(v is None for v in values) else np.concatenate(values)

        return Commands(np.concatenate([part.times for part in both]), *map(joined, INPUTS))

    def rows(self, rows: slice) -> "Recording":
        """A piece of it. Inputs before the piece are kept beside it, so that drives start as they were."""
        begin = rows.indices(len(self.times))[0]
        arrays = {name: getattr(self, name)[rows] for name in (*INPUTS, *MEASURED) if getattr(self, name) is not None}
        commands, count = self.commands, 0 if self.earlier is None else len(self.earlier.times)
        before = slice(None, count + begin)
        inputs = (None if values is None else values[before] for values in (commands.u_x, commands.u_l))
        return replace(
            self,
            times=self.times[rows],
            begun=self.begun + float(self.times[begin] - self.times[0]),
            earlier=Commands(commands.times[before], *inputs) if count + begin else None,
            fresh={name: flag[rows] for name, flag in self.fresh.items()},
            initial=self.initial if begin == 0 else {},
            extras={name: values[rows] for name, values in self.extras.items()},
            **arrays,
        )

    @property
    def covered(self) -> dict[str, tuple[float, float]]:
        """The places of the cart and rope lengths (`x`, `l` [m]) and the inputs (`u_x`, `u_l`) that it reaches, each
        from least to most."""
        length = np.asarray(self.locked_length) if self.l is None and self.locked_length is not None else self.l
        reached = {"x": self.x, "l": length, "u_x": self.u_x, "u_l": self.u_l}
        return {name: (float(np.min(v)), float(np.max(v))) for name, v in reached.items() if v is not None}

    @property
    def has_cart(self) -> bool:
        """Whether a cart moves: without `x`, the pendulum hangs from a fixed point."""
        return self.x is not None

    @property
    def has_swing(self) -> bool:
        """Whether a load swings: without `psi` and `l` the cart is alone, with only `l` the hoist is."""
        return self.psi is not None or (self.x is not None and self.l is not None)

    @property
    def has_hoist(self) -> bool:
        """Whether the rope is wound: without `u_l` it is locked."""
        return self.u_l is not None


def as_recordings(recordings: Recording | Iterable[Any]) -> tuple[Recording, ...]:
    """Recordings as a tuple, of which one may be given alone.

    Raises:
        InputError: something else is among them, such as the name of a file.
    """
    every = (recordings,) if isinstance(recordings, Recording | str | PathLike) else tuple(recordings)
    for each in every:
        if not isinstance(each, Recording):
            what = repr(str(each)) if isinstance(each, str | PathLike) else f"a {type(each).__name__}"
            raise InputError(f"{what} where a recording belongs; read files with load_recording, or load_recordings")
    return every


def required(recordings: Recording | Iterable[Any]) -> tuple[Recording, ...]:
    """Recordings as a tuple, of which there must be one at least.

    Raises:
        InputError: there is none.
    """
    every = as_recordings(recordings)
    if not every:
        raise InputError("no recordings: give at least one to learn the model from")
    return every


def covered_by(recordings: Iterable[Recording]) -> dict[str, tuple[float, float]]:
    """What several recordings reach together; see `Recording.covered`."""
    each = [recording.covered for recording in recordings]
    found = {name: [own[name] for own in each if name in own] for name in ("x", "l", "u_x", "u_l")}
    return {name: (min(low for low, _ in ends), max(high for _, high in ends)) for name, ends in found.items() if ends}
