"""A controller on the virtual rig, move by move."""

import numpy as np

import jbridge
from virtual import play, sampled


def on_rig(controller: jbridge.Controller, course: jbridge.Course, truth: dict | None = None) -> list[dict]:
    """How every move of a course went on a rig, with its signals.

    Args:
        controller: what commands.
        course: its moves.
        truth: the rig's own numbers; those of `truth.txt` by default.
    """
    out = []
    for number in range(len(course.legs)):
        path = course.path(number)
        begin = course.legs.start[number]
        law, seconds = sampled(controller, path), float(path.times[-1])
        table = play(law, seconds, 40 + number, truth, x=float(begin[0]), l=float(begin[1]))
        every = round(controller.period / 0.005)
        run = {name: np.asarray(values)[::every][: len(path.times)] for name, values in table.items()}
        move = jbridge.moves(
            path.times,
            np.stack([path.x, path.l], 1),
            np.stack([run[k] for k in ("x", "psi", "l")], 1),
            np.stack([run["u_x"], run["u_l"]], 1),
        )[0]
        out.append(
            {
                "settling": move.settling_time, "overshoot": move.overshoot, "swing": move.residual_swing,
                "itae": move.itae, "steady_error": move.steady_error, "effort": move.effort,
                "travel": move.travel,
                "run": {name: run[name] for name in ("t", "x", "psi", "l", "u_x", "u_l")},
                "reference": {"t": path.times, "x": path.x, "l": path.l},
            }
        )  # fmt: skip
    return out
