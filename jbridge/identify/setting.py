"""Lanes of recordings for a plant, with steps and starts as its hidden states need them."""

from collections.abc import Sequence

import numpy as np

from .._types import AXES
from ..identification.problem import Setting, overrides
from ..model.effects.base import AbstractSensor
from ..model.effects.drives import InputDelay
from ..model.effects.flexible import Backlash, DoublePendulum, RopeElasticity
from ..model.effects.friction import PreslidingFriction
from ..model.effects.sensors import SensorDelay
from ..model.parameters import ParameterTable
from ..model.plant import Plant
from ..model.steps import longest_step
from ..recordings import Recording
from .lanes import HISTORY, Batch, make_batch

_BENT = 4.0
"""Way over a presliding spring's own after which how it was bent is forgotten."""


def lanes_for(
    table: ParameterTable,
    plant: Plant,
    setting: Setting,
    recordings: Sequence[Recording],
    window: float | None = None,
    like: Batch | None = None,
) -> Batch:
    """Lanes of recordings for a plant, with steps as its stiffness needs them."""
    return make_batch(
        recordings,
        setting.noise,
        step=longest_step(plant, setting.step),
        window=window,
        size=table.size,
        overrides=overrides(table, recordings),
        hidden=plant.hidden,
        slack=_slack(plant),
        beat=_beat(plant),
        bounce=_bounce(plant),
        # A lag may grow beyond what was recorded, its inputs may not.
        history=max(HISTORY, min(_memory(plant), max(recording.duration for recording in recordings))),
        altered=[axis for axis in AXES if any(plant.all(AbstractSensor, f"{axis}_sensor"))],
        late=[axis for axis in AXES if any(plant.all(SensorDelay, f"{axis}_sensor"))],
        like=like,
    )


def _slack(plant: Plant) -> float:
    """Way of the cart [m] over which what is hidden between it and its motor, or its rail, makes a difference."""
    play, sliding = plant.only(Backlash), plant.only(PreslidingFriction)
    way = 0.0 if play is None else float(play.gap)
    return way if sliding is None else way + _BENT * float(sliding.level) / float(sliding.stiffness)


def _beat(plant: Plant) -> float:
    """Period of a load that swings below a hook at rest [s]."""
    pendulum = plant.only(DoublePendulum)
    if pendulum is None:
        return 0.0
    return 2.0 * np.pi * float(np.sqrt(pendulum.link / plant.bridge.gravity))


def _bounce(plant: Plant) -> tuple[float, float] | None:
    """How far a load stretches its rope at rest [m], and how fast it moves if it swings by that [m/s]."""
    rope = plant.only(RopeElasticity)
    if rope is None:
        return None
    gravity = float(plant.bridge.gravity)
    stretch = float(plant.bridge.load_mass) * gravity / float(rope.stiffness)
    return stretch, float(np.sqrt(stretch * gravity))


def _memory(plant: Plant) -> float:
    """How long an input is felt [s], with room for a fit to lengthen delays and lags by half."""
    delay = sum(float(effect.delay) for effect in plant.all(InputDelay))
    return 1.5 * delay + 5.0 * max(float(c) for c in plant.time_constants())
