"""What happened once: recordings that are met badly where all the others are met well."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .._types import AXES
from ..identify.evaluate import Run
from ..identify.latent import Latent
from ..identify.result import Trace
from ..model.effects.base import AXIS_OF_SITE
from .adequacy import LARGE, ratios
from .locate import intervals
from .missing import force_along, leading_site, tracks_of
from .result import Interval

_SHARE = 1 / 3
"""Largest share of the recordings that may count as the odd ones,"""
_CLEARLY = 3.0
"""and how many times worse each must be met than any of the others: friction that wanders makes some a little worse."""


class Once(NamedTuple):
    """Something that happened in few recordings, and not in the others."""

    channel: str
    """That which is met worst there,"""
    axis: str
    """and the axis on which a force would explain it best."""
    recordings: tuple[str, ...]
    """Those, the worst first."""
    others: float
    """Error over noise of the worst channel of all the others."""
    when: tuple[Interval, ...] = ()


def happened_once(run: Run, names: Sequence[str]) -> Once | None:
    """The few recordings that hold all large errors, if no other has one.

    Args:
        run: free runs of the model as given over the recordings.
        names: of those.
    """
    found = ratios(run.batch, run.predicted)
    worst = found.max(axis=1)
    odd = worst > LARGE
    if not 0 < np.count_nonzero(odd) <= _SHARE * len(names) or worst[odd].min() < _CLEARLY * worst[~odd].max():
        return None
    order = sorted(np.flatnonzero(odd), key=lambda i: -worst[i])
    channel = AXES[int(np.argmax(found[order[0]]))]
    return Once(channel, channel, tuple(names[int(i)] for i in order), float(worst[~odd].max()))


def timed(once: Once, latent: Latent, traces: Sequence[Trace]) -> Once:
    """The same with the times at which a smoothed missing force stands out there.

    Args:
        once: what happened.
        latent: unknown forces beside the model as given.
        traces: the training recordings.
    """
    site = leading_site(latent.evidence)
    axis = once.channel if site is None else AXIS_OF_SITE[site]
    tracks = tracks_of(force_along(latent.forces, traces, axis), traces, axis)
    when = tuple(interval for interval in intervals(tracks) if interval.recording in once.recordings)
    return once._replace(axis=axis, when=when)
