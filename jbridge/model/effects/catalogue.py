"""The one list of the effects that there are; a new effect is one class and one line here."""

from collections.abc import Mapping
from typing import Any

from ..fields import parameters_of
from .base import AbstractEffect
from .bodies import RodInertia
from .cable import CableDrag
from .drives import (
    ActuatorLag,
    DeadZone,
    DrumRadiusChange,
    GainAsymmetry,
    GainDrift,
    InputDelay,
    Saturation,
    StartDelay,
    TorqueRipple,
)
from .flexible import Backlash, BeltCompliance, DoublePendulum, HoistBacklash, RopeElasticity
from .forces import (
    ConstantForce,
    EndStop,
    LengthDependentDamping,
    LoadDrag,
    PeriodicForce,
    PowerLawDamping,
    QuadraticDrag,
    RailInclination,
    ResidualForce,
    SpringForce,
    Wind,
)
from .friction import (
    CoulombFriction,
    DirectionDependentFriction,
    FrictionDrift,
    LoadDependentFriction,
    PositionDependentFriction,
    PositionDirectionFriction,
    PreslidingFriction,
    StribeckFriction,
)
from .motors import BackEmf, ForceLimit, Freewheeling, SpeedDrive
from .sensors import ClockScale, MissedCounts, SensorDelay, SensorEccentricity, SensorOffset, SensorScale

CATALOGUE: dict[str, type[AbstractEffect]] = {
    cls.kind: cls
    for cls in (
        CoulombFriction,
        StribeckFriction,
        DirectionDependentFriction,
        PositionDependentFriction,
        PositionDirectionFriction,
        LoadDependentFriction,
        PreslidingFriction,
        QuadraticDrag,
        FrictionDrift,
        ConstantForce,
        RailInclination,
        SpringForce,
        CableDrag,
        PeriodicForce,
        EndStop,
        LoadDrag,
        Wind,
        LengthDependentDamping,
        PowerLawDamping,
        RodInertia,
        RopeElasticity,
        DoublePendulum,
        BeltCompliance,
        Backlash,
        HoistBacklash,
        DeadZone,
        Saturation,
        InputDelay,
        StartDelay,
        ActuatorLag,
        GainAsymmetry,
        GainDrift,
        DrumRadiusChange,
        ForceLimit,
        BackEmf,
        Freewheeling,
        SpeedDrive,
        TorqueRipple,
        SensorOffset,
        SensorScale,
        SensorDelay,
        MissedCounts,
        SensorEccentricity,
        ClockScale,
    )
}
"""Effect class by kind, in the order of the documentation's table."""

UNNAMED: dict[str, type[AbstractEffect]] = {ResidualForce.kind: ResidualForce}
"""What a model file may hold besides, but no diagnosis names."""

KINDS: dict[str, type[AbstractEffect]] = CATALOGUE | UNNAMED
"""Everything that a model file may hold."""


def make_effect(kind: str, site: str, values: Mapping[str, Any]) -> AbstractEffect:
    """An effect from parameter values by key; what is not given stands at its null value."""
    cls = KINDS[kind]
    infos = parameters_of(cls)
    arguments: dict[str, Any] = {info.name: info.null for info in infos.values()}
    for key, value in values.items():
        arguments[infos[key].name if key in infos else key] = value
    return cls(**arguments, site=site)
