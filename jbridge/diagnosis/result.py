"""What a diagnosis reports: the verdict, the place, the named physics, and the proof."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from .._display import Displayed
from ..identification.result import Errors, Estimate, Trace
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
    repeatable_before: float | None
    """Share of the force that the model as given leaves unexplained which a flexible force learned on other recordings
    predicts, 0 to 1; None where none is left,"""
    repeatable_after: float | None
    """and of what the final model leaves."""
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
class Likeness:
    """What a missing force is like. Shares are of its mean square, in recordings that took no part in the fit."""

    foreseen: float
    """By what foresees most, alone or all together."""
    by: Mapping[str, float]
    """By each variable alone: `x`, `v_x`, `u_x`, `psi`, `t` and so on; `x, direction` is `x` in either direction."""
    odd: float | None
    """Share of what is foreseen that reverses with the velocity; None where too little is foreseen."""
    energy: float
    """Work that it does over that of its size: -1 takes energy out only, +1 puts energy in only."""
    period: float | None
    """Distance after which it repeats [m, rad]; None where it does not."""
    memory: float
    """Further share that the distance or the time since the last reversal foresees."""
    statement: str
    """The same for the rig's owner; empty where nothing can be said."""


@dataclasses.dataclass(frozen=True)
class MissingForce:
    """The force that a recording needs on one axis beyond what the model has, smoothed."""

    recording: str
    times: NDArray[np.float64]
    """From the recording's start [s], `(time,)`."""
    mean: NDArray[np.float64]
    """[N, N m, N]; NaN where the recording does not tell it."""


@dataclasses.dataclass(frozen=True)
class Location:
    """Where the mismatch is."""

    site: str | None
    equation: str
    """`cart`, `swing`, `hoist` or `none`."""
    sites: Mapping[str, float]
    """Share of the criterion's gain by site, largest first."""
    where: tuple[Region, ...]
    when: tuple[Interval, ...]
    forces: tuple[MissingForce, ...] = ()
    """What the model as given lacks, by training recording."""
    likeness: Likeness | None = None


@dataclasses.dataclass(frozen=True)
class Rival:
    """An explanation that the recordings cannot tell from the chosen one."""

    kind: str
    site: str
    probability: float
    parameters: Mapping[str, Estimate]
    holdout: Mapping[str, float]
    """Free-run error on the hold-out by channel [m, rad, m]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class NamedEffect:
    """A piece of physics with its parameters."""

    kind: str
    site: str
    probability: float | None
    """Its weight among itself and its equivalents, as a mean over resamples of the recordings' blocks; None where no
    time was left to compare it with what came near."""
    parameters: Mapping[str, Estimate]
    equivalents: tuple[Rival, ...]
    statement: str
    status: str = "confirmed"
    """`confirmed` by the hold-out, `suggested`, `event` for what happened once, in the recordings alone; `given` for
    what the model had."""
    explained: float | None = None
    """Share of the hold-out's excess squared error in windows of 1 s that comes back without it."""
    in_model: bool = True
    """Whether the final model has it: not an event, nor what the hold-out speaks against."""
    recording: str | None = None
    """The one recording in which it happens; None for what acts in all. Its moments count from that run's beginning."""


@dataclasses.dataclass(frozen=True)
class Horizon:
    """Errors in windows of one length, by channel [m, rad, m]."""

    seconds: float
    before: Mapping[str, float]
    """Root mean square error on the hold-out of the model as given, refitted,"""
    after: Mapping[str, float]
    """and of the final model."""
    typical_before: Mapping[str, float]
    """Geometric mean over windows in motion."""
    typical_after: Mapping[str, float]
    scatter: Mapping[str, float] | None
    """How far runs of one input differ; None where no input was recorded twice."""


@dataclasses.dataclass(frozen=True)
class NotSeen:
    """An effect that was not named, and how large it may be all the same."""

    kind: str
    site: str
    parameter: str
    limit: float | None
    """Upper 95 % bound of the parameter's distance from where the effect is absent (for a stiffness, a drive's limit
    or the place of a stop: the value from which on it would have been seen); None where these recordings give none."""
    unit: str
    change: float | None
    """By how much a simulation of the training recordings would be off if the rig had the effect at its limit and the
    model, fitted to them, had not: root mean square over the noise, of the channel that it changes most. None where
    there is no limit."""
    notable: bool
    """Whether what may be hidden is more than noise."""
    statement: str


@dataclasses.dataclass(frozen=True)
class NextExperiment:
    """An input to play that would separate what cannot be told apart yet."""

    purpose: str
    separates: tuple[str, ...]
    columns: Mapping[str, object]
    """Columns of the CSV: `t` [s] and the inputs."""
    expected_wrong: float
    """Chance that a diagnosis continued with it still prefers a wrong one of them."""
    start: Mapping[str, float]
    """Where to start, at rest: any of `x` [m], `psi` [rad], `l` [m]."""


@dataclasses.dataclass(frozen=True)
class Former:
    """What an earlier diagnosis left open."""

    explanations: tuple[Mapping[str, object], ...]
    """`kind`, `site` and `probability` of everything that was named or could not be told from it."""

    @property
    def names(self) -> frozenset[tuple[str, str]]:
        """Kind and site of each."""
        return frozenset((str(row["kind"]), str(row["site"])) for row in self.explanations)


@dataclasses.dataclass(frozen=True)
class Continued:
    """What a diagnosis was continued from, and what has become of it."""

    recordings: tuple[str, ...]
    """The new ones."""
    before: tuple[Mapping[str, object], ...]
    """What could not be told apart: `kind`, `site` and `probability` of each explanation, by effect."""
    after: tuple[Mapping[str, object], ...]
    statement: str


@dataclasses.dataclass(frozen=True, repr=False, kw_only=True)
class Diagnosis(Displayed):
    """Everything that `report.json` and `report.html` tell."""

    verdict: str | None
    """`adequate`, `missing_physics` or `unknown`; None where the search was interrupted, and the hold-out is unseen."""
    complete: bool
    """Whether what remains is noise, or scatter that was measured."""
    explained: Mapping[str, float]
    """Share of the hold-out's excess squared error in windows of 1 s that confirmed effects close, by channel with an
    error beyond its noise; `all` is the mean."""
    stopped: str
    """Why the search ended: `criterion`, `budget` or `interrupted`."""
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
    horizons: tuple[Horizon, ...]
    holdout: tuple[str, ...]
    """Recordings that no number was learned from."""
    traces: tuple[Trace, ...]
    trials: tuple[Mapping[str, object], ...]
    """Models that were refitted in each round: what was changed, the gain of the criterion and its price."""
    not_seen: tuple[NotSeen, ...]
    """What else of the catalogue may hide in these recordings, the notable first."""
    next_experiment: NextExperiment | None
    continued: Continued | None = None
    """Of a diagnosis that goes on from an earlier one."""
    warnings: tuple[str, ...]
    notes: tuple[str, ...] = ()
    settings: Mapping[str, object]
    seconds: float = 0.0
