"""Where a simulation stands beside what was measured: a Kalman filter on what it leaves.

A model that lacks a force moves away from the rig within the half second that an initial state is estimated from, and
no initial state makes up for that. Its error in one channel is taken for a free oscillation (a free motion, where
nothing pulls back) that a random force drives,

    d delta = delta' dt,   d delta' = -w^2 delta dt + sqrt(q) dW,   residual = delta + noise

(Kalman, Journal of Basic Engineering 82, 1960). The strength `q` of the force is the one with which the first halves
of a recording's stretches foretell the second halves best. Unless the residuals are so much more likely with it that
they pay the price of one more number, nothing is corrected; so it is nearly always with a model that lacks nothing.
"""

import numpy as np
from numpy.typing import NDArray

_STRENGTHS = np.concatenate([[1e-3], np.logspace(1.0, 9.0, 17)])
"""Strengths that are tried, over the variance of the noise [1/s^3]. The first is as good as none; with samples every
5 ms the second remembers some tenths of a second, and the largest single samples."""
_TAILS = 4.0
"""Degrees of freedom of Student's t for readings."""


def corrections(
    times: NDArray[np.float64],
    residual: NDArray[np.float64],
    measured: NDArray[np.bool_],
    spread: NDArray[np.float64],
    frequency: float,
) -> NDArray[np.float64]:
    """Error of a simulation and its rate at the end of each stretch, `(stretch, 2)`, over the noise [1 and 1/s].

    Args:
        times: of each stretch's samples and, last, of its end, `(stretch, sample + 1)` [s]; the end again after it.
        residual: measured less simulated over the noise, `(stretch, sample)`.
        measured: which samples were measured.
        spread: standard deviations of the error and its rate where a stretch begins, over the noise, `(stretch, 2)`.
        frequency: `w` [rad/s], 0 where nothing pulls an error back.
    """
    q = _STRENGTHS
    shape = len(times), len(q)
    place, rate = np.zeros(shape), np.zeros(shape)
    p, v = (np.repeat(spread[:, k, None] ** 2, len(q), axis=1) for k in range(2))
    c = np.zeros(shape)
    ahead, faster, missed, unlikely = (np.zeros(shape) for _ in range(4))
    middle = 0.5 * (times[:, 0] + times[:, -1])
    later = times[:, :-1] >= middle[:, None]
    for k in range(residual.shape[1]):
        # From the middle on, what was known by then goes on by itself.
        first = (later[:, k] & ~later[:, k - 1] if k else later[:, k])[:, None]
        ahead, faster = np.where(first, place, ahead), np.where(first, rate, faster)
        seen = measured[:, k, None]
        missed += np.where(seen & later[:, k, None], (residual[:, k, None] - ahead) ** 2, 0.0)
        variance = p + 1.0
        miss = np.where(seen, residual[:, k, None] - place, 0.0)
        unlikely += np.where(seen, _unlikely(miss, variance), 0.0)
        # A reading that is far off tells the less, as one of Student's t does.
        trusted = p + np.maximum((_TAILS + miss**2 / variance) / (_TAILS + 1.0), 1.0)
        to_place, to_rate = np.where(seen, p / trusted, 0.0), np.where(seen, c / trusted, 0.0)
        place, rate = place + to_place * miss, rate + to_rate * miss
        p, c, v = p - to_place * p, c - to_place * c, v - to_rate * c
        dt = (times[:, k + 1] - times[:, k])[:, None]
        keep, turn = np.cos(frequency * dt), dt * np.sinc(frequency * dt / np.pi)
        back = -(frequency**2) * turn
        place, rate = keep * place + turn * rate, back * place + keep * rate
        ahead, faster = keep * ahead + turn * faster, back * ahead + keep * faster
        p, c, v = (
            keep * keep * p + 2.0 * keep * turn * c + turn * turn * v + q * dt**3 / 3.0,
            keep * back * p + (keep * keep + turn * back) * c + turn * keep * v + q * dt**2 / 2.0,
            back * back * p + 2.0 * back * keep * c + keep * keep * v + q * dt,
        )
    count = np.maximum((measured & later).sum(axis=1), 1)[:, None]
    best = int(np.argmin(np.log1p(missed / count).sum(axis=0)))
    alone = np.where(measured, _unlikely(residual, np.ones_like(residual)), 0.0).sum()
    if alone - unlikely[:, best].sum() <= 0.5 * np.log(max(int(measured.sum()), 1)):
        return np.zeros((len(times), 2))
    return np.stack([place[:, best], rate[:, best]], axis=1)


def _unlikely(miss: NDArray[np.float64], variance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Logarithm of the likelihood of readings that are so far off, negative and up to a constant."""
    return 0.5 * ((_TAILS + 1.0) * np.log1p(miss**2 / variance / _TAILS) + np.log(variance))
