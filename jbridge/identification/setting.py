"""Preparation of an estimation: model and data are checked, and the parameters to be estimated selected."""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from .._types import AXES
from ..errors import InputError
from ..model.effects.base import AXIS_OF_SITE, L_SENSOR, MOMENTS, SWING
from ..model.files import Model, requires
from ..model.parameters import Entry, ParameterTable
from ..model.plant import Plant
from ..model.step_size import RIGID
from ..recordings import Recording, check_units, constant_inputs
from .data.noise import noise_floor
from .data.thinning import thinned
from .gains import doubtful_gains

PART_OF = {
    "cart_mass": "x",
    "cart_damping": "x",
    "cart_gain": "x",
    "swing_damping": "psi",
    "winch_mass": "l",
    "hoist_damping": "l",
    "hoist_gain": "l",
    "load_mass": "psi",
    "gravity": "psi",
}
"""The axis that must move for a number of the bridge to matter."""
FINER = 2
"""Steps of predictions for each that a plant needs: those of damped axes err by a third of an encoder's noise
otherwise, which adds up over a recording to what looks like a delay."""
_OWN = 0.1
"""Error of the midpoint method's steps over the noise of the angle, as it is foreseen for a lasting free swing, up to
which it serves. A thousand samples tell of an error that much smaller than the noise of one of them."""
_TRAVEL = 0.05
"""Way of a cart [m] that no rope takes without swinging."""


@dataclasses.dataclass(frozen=True)
class Setting:
    """What does not change during a fit or a diagnosis."""

    recordings: tuple[Recording, ...]
    """Those from which everything is chosen; a hold-out is not among them."""
    noise: Mapping[str, float]
    axes: tuple[str, ...]
    """Axes that move in some recording."""
    units: Mapping[str, str]
    """Unit of each input."""
    length: float
    """Mean rope length of the recordings [m]."""
    masses: Mapping[str, float] = dataclasses.field(default_factory=dict)
    """Masses of the bridge as they were given [kg]."""
    fine: bool = False
    """Whether swings are so wide that steps must be of order 4."""
    slot: float = math.inf
    """Length of each recording's slot on the common clock of events [s]: a moment in slot 0 is the same time since its
    start in every recording, one in slot `k` is in recording `k` alone. A slot begins a quarter of it before its run,
    so that a moment which a fit moves to before the start stays the run's own."""

    def axis_of(self, site: str) -> str:
        """The axis on which an effect at a site acts."""
        return _axis_of(site, self.axes)

    def starts(self, recording: Recording) -> float:
        """When a recording's run starts on the clock of events [s]: never for one from which nothing is chosen, nor for
        one that shares no time since its start with any other."""
        own = next((k for k, each in enumerate(self.recordings, 1) if each is recording), None)
        end = recording.begun + recording.duration
        others = [each for each in self.recordings if each is not recording]
        shares = any(each.begun < end and recording.begun < each.begun + each.duration for each in others)
        return math.inf if own is None or not shares else self.slot * own

    def when(self, moment: float) -> tuple[Recording | None, float]:
        """The one recording in which something happens, if it is one, and the time since its start [s]."""
        number = int(moment / self.slot + 0.25) if 0.75 * self.slot <= moment < math.inf else 0
        own = self.recordings[min(number, len(self.recordings)) - 1]
        start = self.starts(own) if number else math.inf
        return (None, moment) if math.isinf(start) else (own, moment - start)

    def since_start(self, table: ParameterTable, vector: NDArray[np.float64]) -> NDArray[np.float64]:
        """A parameter vector whose moments are times since the start of their recordings."""
        out = vector.copy()
        for place in moments_of(table):
            out[place] = self.when(float(vector[place]))[1]
        return out

    @property
    def period(self) -> float:
        """Sampling period [s], the median of the recordings'."""
        return float(np.median([recording.period for recording in self.recordings]))

    def thinned(self) -> "Setting":
        """The same with at most a sample every few milliseconds: more cost time and tell a fit nothing."""
        return dataclasses.replace(self, recordings=tuple(map(thinned, self.recordings)))


def prepared(
    model: Model, recordings: Sequence[Recording], holdout: Sequence[Recording] = ()
) -> tuple[Model, Setting, tuple[str, ...]]:
    """Model and recordings that go together, with sentences on what is taken as known or is doubtful.

    Args:
        model: as given.
        recordings: from which everything is chosen.
        holdout: further ones, which are only checked.

    Raises:
        InputError: see `make_setting`.
    """
    doubts = tuple(doubt for doubt, _ in doubtful_gains(model, (*recordings, *holdout)))
    model, same = with_overrides(model, recordings)
    setting = make_setting(model, recordings, holdout)
    model, scale = with_a_scale(model, setting.axes)
    return model, setting, (*doubts, *same, *scale)


def with_overrides(model: Model, recordings: Sequence[Recording]) -> tuple[Model, tuple[str, ...]]:
    """The model with those numbers known that every recording sets to the same value, and sentences on them."""
    alike = {
        name: value
        for name, value in recordings[0].override.items()
        if all(recording.override.get(name) == value for recording in recordings)
    }
    bridge = dataclasses.replace(model.plant.bridge, **{name: jnp.asarray(value) for name, value in alike.items()})
    told = [
        f"All recordings set {n} = {v:.6g}: it is taken as known." for n, v in alike.items() if n not in model.known
    ]
    plant = Plant(bridge, model.plant.effects)
    return dataclasses.replace(model, plant=plant, known=model.known | set(alike)), tuple(told)


def make_setting(model: Model, recordings: Sequence[Recording], holdout: Sequence[Recording]) -> Setting:
    """Checks that model and recordings go together.

    Raises:
        InputError: a part that the recordings have is missing in the model, an input has two units, or it never
            changes while its gain is to be estimated.
    """
    everything = (*recordings, *holdout)
    requires(model, _moving(everything))
    check_units([r.name for r in everything], everything)
    _check_sensors(recordings)
    _check_holdout(model, recordings, holdout)
    still = constant_inputs(tuple(recordings))
    for name, gain in (("u_x", "cart_gain"), ("u_l", "hoist_gain")):
        if name in still and gain not in model.known:
            names = ", ".join(r.name for r in recordings if getattr(r, name) is not None)
            raise InputError(
                f"{names}: {name} never changes, so {gain} cannot be estimated: record a run in which it changes, "
                f"or list {gain} under known in the model"
            )
    return setting_of(model.plant, recordings, holdout)


def setting_of(plant: Plant, recordings: Sequence[Recording], holdout: Sequence[Recording] = ()) -> Setting:
    """What recordings and a plant have in common, unchecked."""
    everything = (*recordings, *holdout)
    units: dict[str, str] = {}
    for recording in everything:
        units |= recording.units
    lengths = [
        float(np.mean(r.l)) if r.l is not None else r.locked_length
        for r in recordings
        if r.l is not None or r.locked_length is not None
    ]
    known_lengths = [value for value in lengths if value is not None]
    length = float(np.mean(known_lengths)) if known_lengths else 0.5
    # The hold-out serves for channels that nothing else tells of, and for nothing more.
    # Of the samples that a search has: closer ones of a filtered sensor differ by less than its noise.
    noise = noise_floor([*map(thinned, holdout)]) | noise_floor([*map(thinned, recordings)])
    fine = any(_drifts(r, noise["psi"], plant) for r in everything if r.psi is not None)
    masses = {name: float(getattr(plant.bridge, name)) for name in PART_OF if name.endswith("_mass")}
    masses = {name: mass for name, mass in masses.items() if mass > 0.0}
    given = [float(getattr(effect, key)) for effect in plant.effects for key in MOMENTS if hasattr(effect, key)]
    slot = 2.0 * max(*filter(math.isfinite, given), *(r.begun + r.duration for r in everything), 0.0)
    return Setting(tuple(recordings), noise, _moving(everything), units, length, masses, fine, slot)


def _moving(recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Axes that move in some recording."""
    moving = {
        "x": any(r.has_cart for r in recordings),
        "psi": any(r.has_swing for r in recordings),
        "l": any(r.has_hoist for r in recordings),
    }
    return tuple(axis for axis in AXES if moving[axis])


def _drifts(recording: Recording, noise: float, plant: Plant) -> bool:
    """Whether the midpoint method's own error in predictions of a free swing like the recorded one shows beside the
    noise [rad].

    The method makes a swing of frequency `w` and amplitude `A` too fast by `(w h)^2 A^2 / 25` of it, 5 %
    of `(w h)^2` at most, as periods of simulated swings say. Where one is long, and wide or quick, no other start makes
    up for that, and it would seem to hang on another length of rope.
    """
    assert recording.psi is not None
    size = recording.psi - np.mean(recording.psi)
    times, weights = recording.times - recording.start, size**2 + 1e-12
    length = recording.locked_length if recording.l is None else float(np.average(recording.l, weights=weights))
    if length is None or not length > 0.0:
        return False
    # A later or earlier start takes up a part of it.
    late = times - np.average(times, weights=weights)
    bridge = plant.bridge
    # A light cart is swung by its load.
    share = float(bridge.load_mass / bridge.cart_mass) if recording.has_cart else 0.0
    frequency = float(np.sqrt(bridge.gravity / length * (1.0 + share)))
    amplitude = np.sqrt(4.0 / 3.0 * np.mean(size**4) / max(float(np.mean(size**2)), 1e-12))
    fast = frequency**3 * float(np.sqrt(np.mean((size * late) ** 2))) * min(float(amplitude) ** 2 / 25.0, 0.05)
    return fast * (RIGID / FINER) ** 2 > _OWN * noise


def _check_sensors(recordings: Sequence[Recording]) -> None:
    """Refuses a reading that never changes although what it measures must."""
    for axis, cause, least, what in (
        ("x", "u_x", 0.0, "u_x does"),
        ("psi", "x", _TRAVEL, "the cart moves"),
        ("l", "u_l", 0.0, "u_l does"),
    ):
        seen = [r for r in recordings if getattr(r, axis) is not None]
        if not seen or any(np.ptp(getattr(r, axis)) > 0 for r in seen):
            continue
        for recording in seen:
            values = getattr(recording, cause)
            if values is not None and np.ptp(values) > least:
                raise InputError(
                    f"{recording.name}, column {axis}: it never changes, although {what}: check the sensor, or leave "
                    f"the column out ([columns] {axis} = false in the sidecar)"
                )


def _check_holdout(model: Model, recordings: Sequence[Recording], holdout: Sequence[Recording]) -> None:
    """Refuses a proof that asks for numbers of which no recording tells, and one that is a copy of what it proves."""
    for part, has, numbers in (
        ("a cart", "has_cart", ("cart_mass", "cart_gain", "cart_damping")),
        ("a swing", "has_swing", ("load_mass", "swing_damping")),
        ("a driven hoist", "has_hoist", ("hoist_gain", "hoist_damping")),
    ):
        if any(getattr(r, has) for r in recordings):
            continue
        unknown = [name for name in numbers if name not in model.known]
        for proof in holdout:
            if getattr(proof, has) and unknown:
                raise InputError(
                    f"{proof.name}: {part}, which no other recording has, so {unknown[0]} would be a guess: leave it "
                    f"out of the proof, add a recording with {part}, or list {', '.join(unknown)} under known"
                )
    for proof in holdout:
        for recording in recordings:
            if _same_samples(proof, recording):
                raise InputError(
                    f"{proof.name}: the same samples as {recording.name}; the hold-out needs another recording"
                )


def _same_samples(one: Recording, other: Recording) -> bool:
    pairs = [(getattr(one, name), getattr(other, name)) for name in ("times", "u_x", "u_l", *AXES)]
    return all(a is b or (a is not None and b is not None and np.array_equal(a, b)) for a, b in pairs)


def with_a_scale(model: Model, axes: Sequence[str]) -> tuple[Model, tuple[str, ...]]:
    """The model with a mass held where nothing else tells how large forces are, and a sentence on that.

    Masses, gains, dampings and levels of friction have a factor in common that no motion shows. If all of them were
    free, no force could be told from its absence.
    """
    table = ParameterTable(model.plant)
    forces = {entry.group for entry in table.entries if entry.is_force and axis_of_number(entry, axes) in axes}
    mass = next((name for name, axis in PART_OF.items() if name.endswith("_mass") and axis in axes), None)
    if mass is None or forces & model.known:
        return model, ()
    told = f"No mass or force of the moving parts is known, so {mass} is taken as known; all forces scale with it."
    return dataclasses.replace(model, known=model.known | {mass}), (told,)


def axis_of_number(entry: Entry, axes: Sequence[str]) -> str:
    """The axis on which a number of a plant acts, where these axes move."""
    return PART_OF[entry.key] if entry.owner < 0 else _axis_of(_site_of(entry), axes)


def _axis_of(site: str, axes: Sequence[str]) -> str:
    """The axis of a site, where these axes move: the swing feels the length of a rope that is locked."""
    locked = site == L_SENSOR and AXIS_OF_SITE[site] not in axes
    return AXIS_OF_SITE[SWING if locked else site]


def _site_of(entry: Entry) -> str:
    return entry.group.split("@", 1)[1].split(".")[0].split("#")[0]


def resolve(plant: Plant, length: float) -> Plant:
    """The plant with reference lengths that the model file leaves open set to the recordings' mean rope length [m]."""
    effects = []
    for effect in plant.effects:
        reference = getattr(effect, "length", None)
        if reference is not None and bool(jnp.isnan(reference)):
            effect = eqx.tree_at(lambda e: e.length, effect, jnp.asarray(length))
        effects.append(effect)
    return Plant(plant.bridge, tuple(effects))


def free_places(table: ParameterTable, known: frozenset[str], setting: Setting) -> NDArray[np.int64]:
    """Places of the parameters that a fit estimates: not known, of parts that move, and meant to be fitted."""
    known_places = {place for name in known for place in table.positions(name)}
    places = []
    for place, may in enumerate(table.fitted()):
        if not may or place in known_places:
            continue
        entry = table.entry(place)
        if entry.owner < 0:
            axis = PART_OF[entry.key]
            if axis not in setting.axes and not (entry.key == "load_mass" and "l" in setting.axes):
                continue
        else:
            site = _site_of(entry)
            # A locked rope's length sensor still tells the length.
            if AXIS_OF_SITE[site] not in setting.axes and site != L_SENSOR:
                continue
        places.append(place)
    return np.array(places, np.int64)


def overrides(table: ParameterTable, recordings: Sequence[Recording]) -> list[dict[int, float]]:
    """Each recording's own parameter values, by place."""
    return [
        {place: value for name, value in recording.override.items() for place in table.positions(name)}
        for recording in recordings
    ]


def moments_of(table: ParameterTable) -> list[int]:
    """Places in the vector of the moments of events."""
    return [place for entry in table.entries if entry.key in MOMENTS for place in table.positions(entry.name)]
