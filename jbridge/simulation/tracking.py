"""`track`: a model under a controller along a reference, and how well that went."""

import dataclasses
import math
from collections.abc import Mapping

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from .._display import Displayed
from .._types import Axes
from ..control.base import Reference
from ..control.compensation import LIMITS, limits_of
from ..control.files import Controller
from ..control.move_metrics import Move, moves
from ..errors import InputError
from ..model.effects.base import CART_DRIVE, HOIST_DRIVE
from ..model.effects.drives import DeadZone
from ..model.files import Model, check_lengths, requires
from ..model.step_size import substeps
from ..trajectory import Path
from .closed_loop import closed_loop, periods_remembered
from .noise import NOISE, Noisy, drawn

_DRIVES = (("u_x", "cart", CART_DRIVE), ("u_l", "hoist", HOIST_DRIVE))
"""Input, what it drives, and the drive's site."""


@dataclasses.dataclass(frozen=True, kw_only=True, repr=False)
class Tracking(Displayed):
    """A closed loop at the controller's samples."""

    times: NDArray[np.float64]
    """[s]"""
    reference: Mapping[str, NDArray[np.float64]]
    """Wanted `x` and `l`, as the controller follows them [m]."""
    reference_speed: Mapping[str, NDArray[np.float64]]
    """The same for their speeds [m/s]."""
    position: Mapping[str, NDArray[np.float64]]
    """True `x` [m], `psi` [rad], `l` [m]."""
    measured: Mapping[str, NDArray[np.float64]]
    """The same as the controller reads them."""
    command: Mapping[str, NDArray[np.float64]]
    """`u_x`, `u_l` in the unit of the inputs, held until the next sample."""
    moves: tuple[Move, ...]
    """How each leg of the reference went."""
    recorded: Mapping[str, tuple[float, float]] = dataclasses.field(default_factory=dict)
    """Where the model's recordings went; see `Model.recorded`."""
    units: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """Unit of each input where it is not volts; see `Model.units`."""
    limits: tuple[float, float] = LIMITS
    """Commands of cart and hoist beyond which the drives saturate, in the unit of the inputs; of a locked rope
    infinite."""
    noise: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Standard deviations of what encoders add to x, psi and l [m, rad, m]."""

    @property
    def columns(self) -> dict[str, NDArray[np.float64]]:
        """A recording of the run: `t`, inputs, what the sensors read, and the reference."""
        wanted = {f"{axis}_ref": values for axis, values in self.reference.items()}
        return {"t": self.times, **self.command, **self.measured, **wanted}


_run = eqx.filter_jit(closed_loop)


def moving(model: Model) -> Axes | None:
    """1 for an axis that moves; None where all do."""
    return None if model.has_hoist else Axes(jnp.ones(()), jnp.ones(()), jnp.zeros(()))


def check_limits(model: Model, controller: Controller) -> None:
    """Checks that every drive of a model can move what it drives in one direction at least.

    Raises:
        InputError: the limit of a drive lies within its dead zone, or is the paper's in volts where the input has
            another unit.
    """
    limits = np.asarray(limits_of(controller.law)).tolist()
    drives = list(zip(limits, LIMITS, _DRIVES, strict=True))[: 2 if model.has_hoist else 1]
    for limit, usual, (name, axis, site) in drives:
        unit = model.units.get(name, "V")
        if unit != "V" and limit == usual:
            raise InputError(
                f"{controller.source or 'the controller'}: it drives the {axis} with {limit:g} V at most, but the"
                f" model's {name} is in {unit}; give a controller for {unit}, with {axis}_limit under [compensation]"
            )
        zones = list(model.plant.all(DeadZone, site))
        least = min(sum(float(getattr(zone, side)) for zone in zones) for side in ("positive", "negative"))
        if limit <= least:
            volts = "" if unit == "V" else "; rules and gains in volts do not suit an input in another unit"
            raise InputError(
                f"{controller.source or 'the controller'}: it drives the {axis} with {limit:.4g} {unit} at most, within"
                f" the model's dead zone of {least:.4g} {unit}, so that nothing moves; set {axis}_limit under"
                f" [compensation] of the controller's file{volts}"
            )


def track(model: Model, controller: Controller, path: Path, *, noise: tuple[float, float, float] = NOISE) -> Tracking:
    """Lets a controller move a model's bridge along a reference, from rest at its beginning.

    Args:
        model: what moves; the cart and the load alone where the rope is locked (`Model.has_hoist`).
        controller: what commands it.
        path: the reference, at the controller's samples (`smooth_path`); the controller's shaping is done here.
        noise: standard deviations of what encoders add to x, psi and l [m, rad, m], by default as in `tune`; the same
            draws in every run.

    Raises:
        InputError: the model lacks a part of the bridge that the reference moves, a drive's limit lies within its dead
            zone, path and controller have different periods, or the loop runs away.
    """
    requires(model, model.axes)
    check_lengths(model)
    if not model.has_hoist and np.ptp(path.l) > 0.0:
        raise InputError(
            f"{model.source or 'the model'}: no winch_mass and no hoist_gain, so that the rope is locked; give a "
            "reference whose l is the rope's length at every point, such as points = [[0.2, 0.42], [0.8, 0.42]]"
        )
    check_limits(model, controller)
    plant, period = model.plant, controller.period
    if len(path.times) < 2 or not np.allclose(np.diff(path.times), period, rtol=1e-6, atol=1e-9):
        raise InputError(
            f"{controller.source or 'the controller'}: it samples every {period:g} s, but the reference does not; "
            "give the reference at the controller's samples"
        )
    wanted, path = path, controller.follows(path)
    # Shaped references end later; what is wanted stays where it is meanwhile, and is what the moves are measured by.
    beyond = [(0, len(path.times) - len(wanted.times)), (0, 0)]
    goal = np.pad(np.stack([wanted.x, wanted.l], axis=1), beyond, mode="edge")
    initial = np.zeros(plant.states)
    initial[0], initial[2] = path.x[0], path.l[0]
    if not model.has_hoist:  # no sensor reads a rope that is locked
        noise = (*noise[:2], 0.0)
    added = drawn(noise, len(path.times))
    response = _run(
        plant,
        controller.law if added is None else Noisy(controller.law, jnp.asarray(added)),
        jnp.asarray(initial),
        Reference(*(jnp.asarray(values) for values in path[1:])),
        period=period,
        substeps=substeps(plant, period),
        memory=periods_remembered(plant, period),
        active=moving(model),
    )
    position = np.stack([np.asarray(values) for values in response.q.axes], axis=1)
    command = np.asarray(response.command)
    lost = np.flatnonzero(~np.isfinite(position).all(axis=1))
    if len(lost):
        raise InputError(
            f"{controller.source or 'the controller'}: the loop runs away {path.times[lost[0]]:.3g} s after its start; "
            "lower the controller's gains, or see whether a voltage has the wrong sign"
        )
    names = ("x", "psi", "l")
    measured = np.stack([np.asarray(values) for values in response.measured], axis=1)
    limits = np.asarray(limits_of(controller.law)).tolist()
    return Tracking(
        times=path.times,
        reference={"x": path.x, "l": path.l},
        reference_speed={"x": path.v_x, "l": path.v_l},
        position=dict(zip(names, position.T, strict=True)),
        measured=dict(zip(names, (measured if added is None else measured + added).T, strict=True)),
        command={"u_x": command[:, 0], "u_l": command[:, 1]},
        moves=moves(path.times, goal, position, command, limits),
        recorded=model.recorded,
        units=model.units,
        limits=(limits[0], limits[1] if model.has_hoist else math.inf),
        noise=noise,
    )
