"""The numbers by which a diagnosis decides which effects it names and which verdict it gives."""

import dataclasses


@dataclasses.dataclass(frozen=True)
class Criteria:
    """Constants of decisions. Halving or doubling any of them changes which of two close models is named, no more,
    unless its line says otherwise."""

    met: float = 1.5
    """Error over noise, or measured scatter, up to which a channel is met; half of it would call noise an error."""
    named: float = 0.5
    """Share of a channel's excess squared error on the hold-out that `missing_physics` asks of confirmed effects; and
    of a recording's that one asks of a number of its own."""
    confirmed: float = 2.0
    """Standard errors over blocks by which the hold-out must be worse without an effect for it to be confirmed."""
    imitated: float = 2.0
    """Factor on the square of the typical error, without an effect, up to which it may imitate what has no name; half
    of it would confirm whatever the hold-out repeats."""
    sure: float = 1.0
    """Standard errors by which a larger model must gain on blocks that are left out: within one of them the smaller
    model stays. Half of it adds effects that imitate what has no name, twice of it misses such as act in few blocks."""
    block: float = 3.0
    """Shortest block of a recording [s] for standard errors, where there are fewer than six recordings."""
    refitted: int = 9
    """Proposals that are refitted in each round; fewer miss what a linear screen underrates, more take time."""
    polished: int = 3
    """Of these, models that are fitted to all windows at most, and one more for each further axis."""
    worth: float = 0.5
    """Share of what the best proposal on an axis promises that another one there must promise to be fitted to all
    windows."""
    rounds: int = 12
    """Most effects that a search adds; a guard, not a limit that is met."""
    apart: float = 0.05
    """Weight, as a mean over resamples, from which on another explanation counts as not told apart; and the chance
    below which a recording's number is none that the others ask for."""
    bootstrap: int = 200
    """Resamples of blocks behind a probability."""
    rivals: int = 3
    """Explanations that are listed beside one that they cannot be told from."""


CRITERIA = Criteria()
