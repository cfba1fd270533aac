"""Input shaping: a reference split into impulses that cancel the swing they cause (Singer and Seering 1990)."""

import numpy as np

from ..signals import Path

KINDS = ("zv", "zvd")


def shaped(path: Path, frequency: float, damping: float = 0.0, kind: str = "zvd") -> Path:
    """The same path with the cart's reference shaped, longer by half a period of the swing (`zv`) or a whole one.

    Args:
        path: at equally spaced times.
        frequency: of the free swing [rad/s], `sqrt(g / l)` on a rope of length `l`.
        damping: damping ratio of the swing [1].
        kind: `zv` leaves no swing if the frequency is right; `zvd` little even if it is not quite.

    Raises:
        ValueError: the kind is neither.
    """
    if kind not in KINDS:
        raise ValueError(f"{kind!r} is neither of {', '.join(KINDS)}")
    root = np.sqrt(1.0 - damping**2)
    ratio = np.exp(-damping * np.pi / root)
    weights = np.array([1.0, ratio] if kind == "zv" else [1.0, 2.0 * ratio, ratio**2])
    weights /= weights.sum()
    delays = np.arange(len(weights)) * np.pi / (frequency * root)
    period = float(path.times[1] - path.times[0])
    extra = int(np.ceil(delays[-1] / period))
    times = path.times[0] + period * np.arange(len(path.times) + extra)

    def late(values: np.ndarray, after: float) -> np.ndarray:
        return np.interp(times - after, path.times, values)

    x, v_x = (
        sum(weight * late(values, delay) for weight, delay in zip(weights, delays, strict=True))
        for values in (path.x, path.v_x)
    )
    return Path(times, x, late(path.l, 0.0), v_x, late(path.v_l, 0.0))
