"""Where a simulation stands beside what was measured: a Kalman filter on what it leaves.

A model that lacks a force moves away from the rig within the half second that an initial state is estimated from, and
no initial state makes up for that. Its error in one channel is taken for a point that a random force accelerates,

    d delta = delta' dt,   d delta' = sqrt(q) dW,   residual = delta + noise,

whose strength `q` is the one that makes a recording's residuals most likely (Kalman, Journal of Basic Engineering 82,
1960; Schweppe, IEEE Transactions on Information Theory 11, 1965). It is 0, and so is every correction, unless the
residuals pay the price of one more number: a model that lacks nothing is simulated as it is.
"""

import math

import numpy as np
from numpy.typing import NDArray

_STRENGTHS = np.concatenate([[0.0], np.logspace(-1.0, 9.0, 21)])
"""Strengths that are tried, over the variance of the noise [1/s^3]. With samples every 5 ms the least of them remembers
half a second, and the largest single samples."""

_TAILS = 4.0
"""Degrees of freedom of Student's t for readings."""


def corrections(
    times: NDArray[np.float64],
    residual: NDArray[np.float64],
    measured: NDArray[np.bool_],
    spread: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Error of a simulation and its rate at the end of each stretch, `(stretch, 2)`, over the noise [1 and 1/s].

    Args:
        times: of each stretch's samples and, last, of its end, `(stretch, sample + 1)` [s]; the end again after it.
        residual: measured less simulated over the noise, `(stretch, sample)`.
        measured: which samples were measured.
        spread: standard deviations of the error and its rate where a stretch begins, over the noise, `(stretch, 2)`.
    """
    q = _STRENGTHS
    moving = (q > 0.0).astype(float)
    shape = len(times), len(q)
    place, rate, fit = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    p, v = (moving * spread[:, k, None] ** 2 for k in range(2))
    c = np.zeros(shape)
    steps = np.diff(times, axis=1)
    for k in range(residual.shape[1]):
        seen = measured[:, k, None]
        variance = p + 1.0
        miss = np.where(seen, residual[:, k, None] - place, 0.0)
        far = miss**2 / variance
        fit -= np.where(seen, 0.5 * ((_TAILS + 1.0) * np.log1p(far / _TAILS) + np.log(variance)), 0.0)
        # A reading that is far off tells the less, as one of Student's t does.
        trusted = p + np.maximum((_TAILS + far) / (_TAILS + 1.0), 1.0)
        to_place, to_rate = np.where(seen, p / trusted, 0.0), np.where(seen, c / trusted, 0.0)
        place, rate = place + to_place * miss, rate + to_rate * miss
        p, c, v = p - to_place * p, c - to_place * c, v - to_rate * c
        dt = steps[:, k, None]
        place = place + dt * rate
        p = p + dt * (2.0 * c + dt * v) + q * dt**3 / 3.0
        c = c + dt * v + q * dt**2 / 2.0
        v = v + q * dt
    total = fit.sum(axis=0)
    best = int(np.argmax(total))
    if total[best] - total[0] <= 0.5 * math.log(max(int(measured.sum()), 1)):
        best = 0
    return np.stack([place[:, best], rate[:, best]], axis=1)
