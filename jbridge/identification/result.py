"""What a fit reports."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from .._display import Displayed
from ..model.files import Model


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A parameter with its 95 % interval; lists where the parameter is a vector. What is not known is None."""

    value: float | list[float]
    std: float | list[float] | None
    low: float | list[float] | None
    high: float | list[float] | None
    unit: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class Trace:
    """One recording beside its simulations, on the engine's grid."""

    recording: str
    role: str
    """`train` or `holdout`."""
    times: NDArray[np.float64]
    """From the recording's start [s]."""
    inputs: Mapping[str, NDArray[np.float64]]
    """`u_x` and `u_l` where present, in the recording's unit."""
    measured: Mapping[str, NDArray[np.float64]]
    """Channels present: `x` [m], `psi` [rad], `l` [m]; NaN where there is no sample."""
    before: Mapping[str, NDArray[np.float64]]
    """Free run of the model as it was, refitted."""
    after: Mapping[str, NDArray[np.float64]]
    """Free run of the final model."""
    coordinates: Mapping[str, NDArray[np.float64]]
    """Smoothed measurement of each axis [m, rad, m]."""
    velocities: Mapping[str, NDArray[np.float64]]
    """Its rate [m/s, rad/s, m/s]."""
    force_before: Mapping[str, NDArray[np.float64]]
    """Force that the motion needs beyond the model's, by axis [N, N m, N]; NaN where an axis rests or reverses.
    Where the model's own motion runs close, what it would seem to need is taken off, since smoothing blurs it alike."""
    force_after: Mapping[str, NDArray[np.float64]]


@dataclasses.dataclass(frozen=True)
class Errors:
    """Root mean square errors of free runs and of windows, by channel [m, rad, m]."""

    free_run: Mapping[str, float]
    window: Mapping[str, float]


@dataclasses.dataclass(frozen=True, repr=False, kw_only=True)
class Fit(Displayed):
    """A model fitted to recordings."""

    model: Model
    estimates: Mapping[str, Estimate]
    """By parameter name (`cart_gain`, `dead_zone@cart_drive.positive`)."""
    train: Errors
    holdout: Errors | None
    noise: Mapping[str, float]
    """Noise of each channel [m, rad, m]."""
    warnings: tuple[str, ...]
    """What the recordings cannot determine, and what else the owner must know; one sentence each."""
    notes: tuple[str, ...]
    """What was detected in the recordings."""
    traces: tuple[Trace, ...]
    """`before` is the model as given, `after` the fitted one."""
    over_foreseen: float
    """Largest error over what noise explains, of all channels and horizons; of the hold-out where there is one."""
    window: float
    """Length of a window [s]."""
    seconds: float
