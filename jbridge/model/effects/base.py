"""What an effect is: its site, its interface, and where a search for it starts.

An effect is one piece of physics that a bridge may or may not have. It has a `kind`, a `site` and parameters; a
parameter's unit, bounds and null value stand beside its field (`fields`). The roles below say where an effect enters:

- friction: a level of dry friction, which may depend on place, velocity, load and time (`AbstractFriction`);
- hysteresis: a force with a hidden spring that slips (`AbstractHysteresis`);
- damping: a smooth force on an axis, where its drive sits (`AbstractDamping`);
- force: a smooth force on cart and load (`AbstractForce`);
- drive: volts in, volts out (`AbstractDrive`), plus delay, lag and drum radius, which the engine asks for by name;
- sensor: true coordinates in, readings out (`AbstractSensor`);
- mechanism: an additional hidden coordinate (`AbstractMechanism`);
- clock: what the time stamps make of time, for which the engine asks by name.
"""

import abc
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._types import Axes, Scalar

CART, SWING, HOIST = "cart", "swing", "hoist"
CART_DRIVE, HOIST_DRIVE = "cart_drive", "hoist_drive"
X_SENSOR, PSI_SENSOR, L_SENSOR = "x_sensor", "psi_sensor", "l_sensor"
CLOCK = "clock"
SITES = (CART, SWING, HOIST, CART_DRIVE, HOIST_DRIVE, X_SENSOR, PSI_SENSOR, L_SENSOR, CLOCK)

AXIS_OF_SITE = {
    CART: "x",
    CART_DRIVE: "x",
    X_SENSOR: "x",
    SWING: "psi",
    PSI_SENSOR: "psi",
    HOIST: "l",
    HOIST_DRIVE: "l",
    L_SENSOR: "l",
    CLOCK: "psi",  # gravity gives the swing its period; gains and dampings of the other axes take any clock
}
"""The axis, and thereby the equation, that a site belongs to."""
DRIVE_OF_AXIS = {"x": CART_DRIVE, "l": HOIST_DRIVE}
MOMENTS = frozenset({"time", "start", "stop"})
"""Keys of the moments at which an event happens [s]."""


_PLACE_UNITS = {
    "x": {"force": "N", "position": "m", "speed": "m/s"},
    "psi": {"force": "N m", "position": "rad", "speed": "rad/s"},
    "l": {"force": "N", "position": "m", "speed": "m/s"},
}


def unit_at(unit: str, site: str, inputs: Mapping[str, str] | None = None) -> str:
    """Fills a parameter's unit in for a site; `inputs` names the unit of each drive's input (volts unless told)."""
    axis = AXIS_OF_SITE[site]
    command = (inputs or {}).get("u_x" if axis == "x" else "u_l", "V")
    return unit.format(input=command, **_PLACE_UNITS[axis])


class Scene(eqx.Module):
    """What the recordings cover: the ranges from which an effect proposes where to start looking for it."""

    low: Mapping[str, float]
    """Smallest value seen of each of `x`, `psi`, `l` (SI) and `u_x`, `u_l` (input unit)."""
    high: Mapping[str, float]
    speed: Mapping[str, float]
    """A high quantile (95 %) of the speed of each axis [m/s, rad/s]."""
    acceleration: Mapping[str, float]
    """A high quantile (99 %) of the acceleration of each axis over 0.1 s, or two samples [m/s², rad/s²]; counts and
    noise make it larger."""
    recorded: tuple[tuple[float, float], ...]
    """Beginnings and ends of the stretches of time that recordings cover, in order, since a run began [s]."""
    runs: tuple[tuple[float, float], ...]
    """Beginning and end of each recording on the common clock of events [s], of those that share time since their start
    with others."""
    period: float
    """Median sampling period [s]."""
    length: float
    """Mean rope length [m]."""
    bridge: Mapping[str, float]
    """The bridge's numbers by name."""
    friction: Mapping[str, float]
    """Plain Coulomb level that the model has at each site now (0 where none)."""

    def span(self, name: str) -> float:
        return self.high[name] - self.low[name]

    def moment(self, share: float) -> float:
        """When this share of the recorded time has passed [s]."""
        edges = np.array(self.recorded)
        passed = np.concatenate([[0.0], np.cumsum(edges[:, 1] - edges[:, 0])])
        k = min(int(np.searchsorted(passed, share * passed[-1], side="right")) - 1, len(edges) - 1)
        return float(edges[k, 0] + share * passed[-1] - passed[k])

    def moments(self, shares: Sequence[float]) -> list[list[float]]:
        """When these shares of the recorded time have passed, in every recording, and in each of them alone [s]."""
        return [[self.moment(s) for s in shares], *([a + s * (b - a) for s in shares] for a, b in self.runs)]


@dataclasses.dataclass(frozen=True)
class Seed:
    """One place to start looking for an effect: parameter values, and which of them are free from there."""

    values: Mapping[str, Any]
    free: tuple[str, ...]
    finite: bool = False
    """False: the effect is absent at `values` (its amplitude is zero), so a linear screen can weigh it."""
    linear: tuple[str, ...] | None = None
    """Of an absent effect, the free numbers that do something at `values`; all by default. An amplitude and a phase
    together stand for a sine and a cosine."""


@dataclasses.dataclass(frozen=True)
class Alike:
    """A plainer explanation that some recordings cannot tell from an effect."""

    own_site: str
    """Where the effect is."""
    kind: str
    site: str
    recordings: str
    """In which recordings the two look alike."""
    separated_by: str
    """The experiment that separates them."""


Values = Mapping[str, Any]
"""Numbers of an effect by key; vectors are arrays."""


@dataclasses.dataclass(frozen=True)
class Contained:
    """A simpler law at the same site, which an effect becomes at some of its values."""

    kind: str
    simpler: Callable[[Values], Values]
    """The simpler law's estimated numbers, from the effect's."""
    same: Callable[[Values, Values], Values]
    """Numbers of the effect at which it is the simpler law, from that law's and its own; one for all of a vector."""


class AbstractEffect(eqx.Module):
    """One piece of physics at one site."""

    kind: eqx.AbstractClassVar[str]
    sites: eqx.AbstractClassVar[tuple[str, ...]]
    sentence: eqx.AbstractClassVar[str]
    """What a rig's owner is told; `{axis}` is filled in with the axis' name."""
    alike: ClassVar[tuple[Alike, ...]] = ()
    """Explanations that some recordings cannot tell from this one."""
    contains: ClassVar[tuple[Contained, ...]] = ()
    """Simpler laws that may take its place, and whose place it takes."""
    beside: ClassVar[tuple[str, ...]] = ()
    """Kinds of which a model must have one at a site for a search to propose this effect there: without them it is
    another law under another name, or asks for recordings that show more. Empty: it is proposed beside everything."""
    site: eqx.AbstractVar[str]

    def __check_init__(self) -> None:
        if self.site not in self.sites:
            raise ValueError(f"{self.kind} cannot be at site {self.site!r}: it goes with {', '.join(self.sites)}")

    @classmethod
    @abc.abstractmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        """Where to start looking for this effect in recordings that cover `scene`."""


class AbstractFriction(AbstractEffect):
    """Dry friction on one axis. Levels of several frictions on an axis add; the engine makes them hold at rest."""

    @abc.abstractmethod
    def levels(self, t: Scalar, q: Scalar, v: Scalar, load: Scalar) -> tuple[Scalar, Scalar]:
        """Largest friction against positive and against negative motion, both >= 0 [N, N m].

        Args:
            t: time since the run began [s].
            q: the axis' coordinate [m, rad].
            v: its velocity [m/s, rad/s].
            load: force of the axis' drive, at the swing the pull on its pivot [N].
        """


class AbstractHysteresis(AbstractEffect):
    """A force of the cart's drive side that remembers: it has a spring, which slips as it nears its end.

    The spring's relative deflection `z` in [-1, 1] is a hidden state, and depends on the way alone, not on the speed.
    """

    level: eqx.AbstractVar[Scalar]
    """Largest force of the spring [N]."""

    @abc.abstractmethod
    def force(self, q: Scalar, z: Scalar) -> Scalar:
        """Force [N] at a position [m] and a relative deflection."""

    @abc.abstractmethod
    def deflection(self, z: Scalar, way: Scalar) -> Scalar:
        """`z` after some `way` [m] in one direction: exact."""

    @abc.abstractmethod
    def steepness(self) -> Scalar:
        """Largest change of the force with the position [N/m], which bounds the length of a step."""


class AbstractDamping(AbstractEffect):
    """A smooth resistance on one axis, acting where the axis' drive and guide sit."""

    @abc.abstractmethod
    def resistance(self, q: Axes, v: Axes) -> Scalar:
        """Generalized force on the effect's own axis [N, N m]."""


class AbstractForce(AbstractEffect):
    """A smooth force on the cart or the load."""

    @abc.abstractmethod
    def force(self, t: Scalar, q: Axes, v: Axes) -> Axes:
        """Generalized forces on the three axes [N, N m, N]."""


class AbstractDrive(AbstractEffect):
    """A memoryless change of a drive's input."""

    order: ClassVar[int] = 0
    """Place in the chain; physics puts saturation before the dead zone before the gain."""
    in_time: ClassVar[bool] = False
    """Whether it depends on time, so that it matters on which side of a delay it stands."""

    @abc.abstractmethod
    def apply(self, t: Float[Array, "*time"], u: Float[Array, "*time"]) -> Float[Array, "*time"]:
        """Input in, input out, each in the input's unit, at times [s] since the run began."""


class AbstractSensor(AbstractEffect):
    """What an encoder makes of a coordinate."""

    order: ClassVar[int] = 0

    @abc.abstractmethod
    def read(
        self, t: Float[Array, " time"], reading: Float[Array, " time"], truth: Float[Array, " time"]
    ) -> Float[Array, " time"]:
        """The reading after this effect, from the reading before it and the true coordinate [m, rad]."""


class AbstractMechanism(AbstractEffect):
    """A compliance or a play that adds a hidden coordinate to the mechanics (see `plant`)."""


def interpolate(knots: Float[Array, " knot"], values: Float[Array, " knot"], q: Scalar) -> Scalar:
    """Piecewise linear through `(knots, values)`, constant beyond the ends.

    A sum of clipped ramps instead of a search and a gather: it vectorises over lanes and differentiates.
    """
    value = values[0]
    for j in range(values.shape[0] - 1):
        width = knots[j + 1] - knots[j]
        # The slope does not depend on q, so it leaves the time loop.
        value = value + (values[j + 1] - values[j]) / width * jnp.clip(q - knots[j], 0.0, width)
    return value


_REPEATED = 4
"""Half waves that recordings cover at least of what is said to repeat along an axis: one wave alone is like any other
smooth law."""


def waves(span: float, count: int) -> list[Seed]:
    """Seeds of a wave along an axis: with half a wave more on the span it is another one, and hides from the next.

    Args:
        span: of the axis that recordings cover [m, rad].
        count: number of seeds.
    """
    return [
        Seed(
            {"amplitude": 0.0, "period": 2 * span / halves, "phase": 0.0},
            ("amplitude", "period", "phase"),
            linear=("amplitude", "phase"),
        )
        for halves in range(_REPEATED, _REPEATED + count)
    ]


MAP_KNOTS = 8
"""Places of a law that is piecewise linear along an axis."""


def uniform_knots(scene: Scene, axis: str, count: int) -> list[float]:
    """Knots over the part of an axis that the recordings cover [m]."""
    low, high = scene.low[axis], scene.high[axis]
    if not high > low:
        low, high = low - 0.5, low + 0.5
    return [float(k) for k in np.linspace(low, high, count)]
