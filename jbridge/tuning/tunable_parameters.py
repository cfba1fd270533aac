"""The numbers of a controller that are tuned, as free coordinates around the controller as it was given.

All coordinates are 0 for the given controller and may take any value within bounds: what must stay positive is
multiplied by an exponential, and corners of fuzzy sets are cumulated from positive gaps, so that they stay in order.
Corners that coincide in the given controller (where one set ends and the next one peaks) go on coinciding, and a
variable that is symmetric about the middle of its universe stays so.
"""

import abc
import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from ..control.base import AbstractController
from ..control.compensation import Compensation
from ..control.fuzzy import FuzzyController
from ..errors import InputError
from ..fuzzy.inference import Mamdani
from ..fuzzy.membership import Gaussian, Trapezoidal, Triangular
from ..fuzzy.rules import Variable

_COARSE = 1.0
"""Spread of what is guessed by orders of magnitude."""
_SAME = 1e-9
"""Share of a universe within which two corners coincide."""
_GAP = 2.0
"""Largest change of a gap or a scale, as a logarithm: a factor of 7 either way."""
_LEAST_WEIGHT = -4.0
"""Smallest logarithm of a rule's weight."""
_MOST_GIVEN_BACK = 0.3
"""Largest change of a compensation upwards, as a logarithm: beyond what is lost, it pushes by itself."""
_CORNERS = {Triangular: ("left", "peak", "right"), Trapezoidal: ("left", "top_left", "top_right", "right")}


@dataclasses.dataclass(frozen=True)
class Knob:
    """One free coordinate."""

    name: str
    low: float
    high: float
    spread: float = 0.3
    """Standard deviation of random starts."""

    @property
    def is_coarse(self) -> bool:
        """Whether it is guessed by orders of magnitude, not by percent."""
        return self.spread >= _COARSE


class AbstractKnobs(abc.ABC):
    """Free coordinates of one kind of controller."""

    knobs: tuple[Knob, ...]

    @abc.abstractmethod
    def set(self, coordinates: Float[Array, " knob"], softness: Array | float | None = None) -> AbstractController:
        """The controller at some coordinates, smooth if a softness is given."""

    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lowest and highest value of each coordinate."""
        return np.array([knob.low for knob in self.knobs]), np.array([knob.high for knob in self.knobs])


class PositiveKnobs(AbstractKnobs):
    """Numbers of any controller, each multiplied by an exponential, so that signs and zeros stay; also of arrays."""

    def __init__(self, law: AbstractController, names: tuple[str, ...]):
        self._law = law
        self._names = names
        values = [np.asarray(getattr(law, name)) for name in names]
        self._places = [np.flatnonzero(value) for value in values]
        knobs = []
        for name, value, places in zip(names, values, self._places, strict=True):
            for place in places:
                at = "".join(f"[{k}]" for k in np.unravel_index(place, value.shape)) if value.ndim else ""
                knobs.append(Knob(f"{name}{at}", -2 * _GAP, 2 * _GAP, _COARSE))
        self._count = len(knobs)
        self._shares = _gives_back(getattr(law, "compensation", None))
        self.knobs = (*knobs, *(_compensation_knobs() if self._shares else ()))

    def set(self, coordinates: Float[Array, " knob"], softness: Array | float | None = None) -> AbstractController:
        begin, values = 0, []
        for name, places in zip(self._names, self._places, strict=True):
            value = jnp.asarray(getattr(self._law, name))
            factors = jnp.ones(value.size).at[places].set(jnp.exp(coordinates[begin : begin + len(places)]))
            values.append(value * factors.reshape(value.shape))
            begin += len(places)
        law = eqx.tree_at(lambda law: [getattr(law, name) for name in self._names], self._law, values)
        return _compensated(law, coordinates[self._count :]) if self._shares else law


def _gives_back(compensation: Compensation | None) -> bool:
    return compensation is not None and (float(compensation.cart) != 0.0 or float(compensation.hoist) != 0.0)


def _compensation_knobs() -> tuple[Knob, ...]:
    return tuple(Knob(f"{axis}.compensation", -_GAP, _MOST_GIVEN_BACK) for axis in ("cart", "hoist"))


def _compensated(law: Any, coordinates: Float[Array, " axis"]) -> Any:
    """The law with more or less given back of what friction and dead zones take."""
    share = jnp.exp(coordinates)
    more = [law.compensation.cart * share[0], law.compensation.hoist * share[1]]
    return eqx.tree_at(lambda law: [law.compensation.cart, law.compensation.hoist], law, more)


class FuzzyKnobs(AbstractKnobs):
    """Corners, widths and weights of both Mamdani systems, the scales of the errors, and a compensation."""

    def __init__(self, law: FuzzyController, *, weights: bool = True, sets: bool = True):
        """
        Args:
            law: the controller as given.
            weights: whether rule weights are tuned.
            sets: whether fuzzy sets are tuned.
        """
        self._law = law
        self._variables: list[tuple[str, str, int, _VariableKnobs, slice]] = []
        knobs: list[Knob] = []
        for axis in ("cart", "hoist"):
            system = getattr(law, axis)
            if not isinstance(system, Mamdani):
                raise InputError(f"the {axis}'s fuzzy system is a {type(system).__name__}'s; only Mamdani's are tuned")
            for role in ("inputs", "outputs") if sets else ():
                for place, variable in enumerate(getattr(system, role)):
                    found = _VariableKnobs(variable)
                    at = slice(len(knobs), len(knobs) + len(found.names))
                    self._variables.append((axis, role, place, found, at))
                    knobs += [Knob(f"{axis}.{variable.name}.{name}", -_GAP, _GAP) for name in found.names]
        self._scales = len(knobs)
        knobs += [Knob(f"{axis}.scale", -_GAP, _GAP, _COARSE) for axis in ("cart", "hoist")]
        self._shares = len(knobs) if _gives_back(law.compensation) else None
        if self._shares is not None:
            knobs += _compensation_knobs()
        self._weights = len(knobs) if weights else None
        if weights:
            for axis in ("cart", "hoist"):
                for number, rule in enumerate(getattr(law, axis).rules):
                    # A little less than up to 1, beyond which rounding must not take a weight.
                    most = -float(np.log(max(float(rule.weight), 1e-3))) - 1e-12
                    knobs.append(Knob(f"{axis}.rule {number + 1}.weight", _LEAST_WEIGHT, most))
        self.knobs = tuple(knobs)

    def set(self, coordinates: Float[Array, " knob"], softness: Array | float | None = None) -> FuzzyController:
        law = self._law
        for axis, role, place, found, at in self._variables:
            law = eqx.tree_at(
                lambda law: getattr(getattr(law, axis), role)[place].sets, law, found.sets(coordinates[at])
            )
        scale = jnp.exp(coordinates[self._scales : self._scales + 2])
        law = eqx.tree_at(
            lambda law: (law.cart_scale, law.hoist_scale),
            law,
            (law.cart_scale * scale[0], law.hoist_scale * scale[1]),
        )
        if self._shares is not None:
            law = _compensated(law, coordinates[self._shares : self._shares + 2])
        if self._weights is not None:
            begin = self._weights
            for axis in ("cart", "hoist"):
                rules = getattr(law, axis).rules
                given = [rule.weight for rule in rules]
                factors = jnp.exp(coordinates[begin : begin + len(rules)])
                law = eqx.tree_at(
                    lambda law: [rule.weight for rule in getattr(law, axis).rules],
                    law,
                    [weight * factor for weight, factor in zip(given, factors, strict=True)],
                )
                begin += len(rules)
        if softness is None:
            return law
        return dataclasses.replace(law, softness=softness)


class _VariableKnobs:
    """The sets of one variable through breakpoints in ascending order, and the widths of its bells."""

    def __init__(self, variable: Variable):
        self._variable = variable
        low, high = float(variable.low), float(variable.high)
        self._span = high - low
        middle = 0.5 * (low + high)
        self._symmetric = _is_symmetric(variable, middle, self._span)
        self._origin = middle if self._symmetric else low
        self._end = high - self._origin
        corners: list[float] = []
        self._bells: list[str] = []
        for label, member in zip(variable.labels, variable.sets, strict=True):
            if type(member) in _CORNERS:
                corners += [float(getattr(member, name)) for name in _CORNERS[type(member)]]
            elif isinstance(member, Gaussian):
                corners.append(float(member.centre))
                key = self._twin(label)
                if key not in self._bells:
                    self._bells.append(key)
        # Infinite corners, those of open shoulders, stay where they are.
        away = np.sort(np.abs(np.array([corner for corner in corners if np.isfinite(corner)]) - self._origin))
        away = away[np.diff(away, prepend=-self._span) > _SAME * self._span]
        inside = (away > _SAME * self._span) & (away < self._end - _SAME * self._span)
        self._points = away[inside]
        self.names = tuple(f"breakpoint {i + 1}" for i in range(len(self._points)))
        self.names += tuple(f"{label}.width" for label in self._bells)

    def _twin(self, label: str) -> str:
        """A label, or that of its mirror image if this is symmetric and comes first."""
        if not self._symmetric:
            return label
        labels = self._variable.labels
        place = labels.index(label)
        return labels[max(place, len(labels) - 1 - place)]

    def sets(self, coordinates: Float[Array, " knob"]) -> tuple[Any, ...]:
        count = len(self._points)
        gaps = jnp.diff(self._points, prepend=0.0) * jnp.exp(coordinates[:count])
        points = jnp.minimum(jnp.cumsum(gaps), self._end)
        widths = dict(zip(self._bells, jnp.exp(coordinates[count:]), strict=True))

        def moved(value: Array) -> Array:
            away = float(value) - self._origin
            near = np.flatnonzero(np.abs(self._points - abs(away)) <= 2 * _SAME * self._span)
            return value if not len(near) else self._origin + np.sign(away) * points[int(near[0])]

        out = []
        for label, member in zip(self._variable.labels, self._variable.sets, strict=True):
            if type(member) in _CORNERS:
                out.append(type(member)(*(moved(getattr(member, name)) for name in _CORNERS[type(member)])))
            elif isinstance(member, Gaussian):
                out.append(Gaussian(member.width * widths[self._twin(label)], moved(member.centre)))
            else:
                out.append(member)
        return tuple(out)


def _is_symmetric(variable: Variable, middle: float, span: float) -> bool:
    """Whether the sets of a variable are each other's mirror images about the middle."""
    for member, other in zip(variable.sets, reversed(variable.sets), strict=True):
        if type(member) is not type(other):
            return False
        if type(member) in _CORNERS:
            names = _CORNERS[type(member)]
            own = [float(getattr(member, name)) - middle for name in names]
            twin = [middle - float(getattr(other, name)) for name in reversed(names)]
        elif isinstance(member, Gaussian) and isinstance(other, Gaussian):
            own = [float(member.centre) - middle, float(member.width)]
            twin = [middle - float(other.centre), float(other.width)]
        else:
            return False
        if not np.allclose(own, twin, rtol=0.0, atol=_SAME * span):
            return False
    return True


def knobs_of(law: AbstractController) -> AbstractKnobs:
    """The coordinates of a controller that can be tuned.

    Raises:
        TypeError: it has none.
    """
    if isinstance(law, FuzzyController):
        return FuzzyKnobs(law)
    knobs = PositiveKnobs(law, tuple(getattr(law, "tunable", ())))
    if not knobs.knobs:
        raise TypeError(f"a {type(law).__name__} has nothing to tune")
    return knobs


def as_arrays(law: AbstractController) -> AbstractController:
    """The controller with arrays for numbers, so that its program serves all of the same structure."""
    return jax.tree.map(jnp.asarray, law)
