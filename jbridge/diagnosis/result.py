"""What a diagnosis reports: the verdict, the place, the named physics, and the proof."""

import dataclasses
from collections.abc import Mapping

from ..identify.result import Errors, Estimate, Trace
from ..model.files import Model


@dataclasses.dataclass(frozen=True)
class Channel:
    """How well one channel is met, before anything is added."""

    rmse: float
    noise: float

    @property
    def ratio(self) -> float:
        return self.rmse / self.noise


@dataclasses.dataclass(frozen=True)
class Adequacy:
    """Whether the model as given, refitted, explains the recordings."""

    alarm: bool
    p_value: float
    """Chance of so much structure in the residuals if the model were right."""
    learnable_before: float
    """Share of the residual that a flexible force learned on other recordings predicts, 0 to 1."""
    learnable_after: float
    channels: Mapping[str, Channel]


@dataclasses.dataclass(frozen=True)
class Region:
    """Where along a variable (`x`, `v_x`, `u_x`, `psi`, `l`, ...) the mismatch sits; SI units or the input's unit."""

    variable: str
    low: float
    high: float
    share: float
    """Share of the mismatch inside."""


@dataclasses.dataclass(frozen=True)
class Interval:
    """When in a recording the mismatch sits, seconds from its start."""

    recording: str
    start: float
    stop: float


@dataclasses.dataclass(frozen=True)
class Location:
    """Where the mismatch is."""

    site: str | None
    equation: str
    """`cart`, `swing`, `hoist` or `none`."""
    sites: Mapping[str, float]
    """Probability by site, largest first."""
    where: tuple[Region, ...]
    when: tuple[Interval, ...]


@dataclasses.dataclass(frozen=True)
class Rival:
    """An explanation that the recordings cannot tell from the chosen one."""

    kind: str
    site: str
    probability: float
    parameters: Mapping[str, Estimate]
    holdout: Mapping[str, float]
    """Free-run error on the hold-out by channel [m, rad, m]."""


@dataclasses.dataclass(frozen=True)
class NamedEffect:
    """A piece of physics with its parameters."""

    kind: str
    site: str
    probability: float | None
    parameters: Mapping[str, Estimate]
    equivalents: tuple[Rival, ...]
    statement: str


@dataclasses.dataclass(frozen=True)
class NextExperiment:
    """An input to play that would separate what cannot be told apart yet."""

    purpose: str
    separates: tuple[str, ...]
    columns: Mapping[str, object]
    """Columns of the CSV: `t` [s] and the inputs."""


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """Everything that `report.json` and `report.html` tell."""

    verdict: str
    """`adequate`, `missing_physics` or `unknown`."""
    statement: str
    adequacy: Adequacy
    location: Location
    effects: tuple[NamedEffect, ...]
    """What was added, by the gap that each closes, the largest first."""
    model_effects: tuple[NamedEffect, ...]
    """The model's own effects, refitted."""
    bridge: Mapping[str, Estimate]
    before: Model
    """The model as given, refitted."""
    model: Model
    """The final model."""
    train_before: Errors
    train_after: Errors
    holdout_before: Errors
    holdout_after: Errors
    noise: Mapping[str, float]
    window: float
    """Length of the windows of the window errors [s]."""
    holdout: tuple[str, ...]
    """Recordings that were opened once, after the model was frozen."""
    traces: tuple[Trace, ...]
    trials: tuple[Mapping[str, object], ...]
    """Every explanation that was refitted: kind, site, cost over noise, accepted or why not."""
    next_experiment: NextExperiment | None
    warnings: tuple[str, ...]
    notes: tuple[str, ...]
    settings: Mapping[str, object]
    seconds: float
