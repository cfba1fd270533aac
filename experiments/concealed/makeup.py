"""The make-up of the parts (`dev`, `rough`, `blind` and others): one case a line.

Each line is the flavour of the rig (full bridge, rope locked, cart alone, pendulum on a fixed cart), what
is concealed, and the loop if it is closed. `null` conceals nothing: only numbers are wrong. With `wander`,
friction wanders by 5 % from place to place and time to time; with `rough`, the sensor noise is larger and
correlated. `at 5` asks for a hold-out error of about five times the noise where the effect is left out; `in clutter`
adds four to eight small forces that no catalogue lists (`clutter.py`), `in recorded forces` what recordings of real
rigs leave (`recorded.py`), each a tenth of that error.
"""

import itertools

HALVES = {
    "dev": [
        "full null",
        "full null",
        "full null closed",
        "full null closed",
        "full null closed",
        "locked null",
        "cart null",
        "pendulum null",
        "locked null closed",
        "full null wander",
        "full null wander closed",
        "full null rough",
        "locked coulomb_friction cart",
        "full stribeck_friction cart",
        "cart direction_dependent_friction cart",
        "full position_dependent_friction cart",
        "locked quadratic_drag cart closed",
        "full backlash cart",
        "cart spring_force cart",
        "locked end_stop cart",
        "full friction_drift cart",
        "full load_drag swing",
        "locked double_pendulum swing",
        "full wind swing closed",
        "full coulomb_friction hoist",
        "full quadratic_drag hoist closed",
        "full direction_dependent_friction hoist",
        "full rope_elasticity hoist",
        "full dead_zone cart_drive closed",
        "full input_delay cart_drive",
        "locked gain_asymmetry cart_drive",
        "full actuator_lag hoist_drive",
        "full drum_radius_change hoist_drive",
        "full sensor_offset psi_sensor",
        "full sensor_scale l_sensor",
        "full sensor_delay x_sensor closed",
        "locked missed_counts x_sensor",
        "locked belt_compliance cart",
        "full wrong_value load_mass",
        "full stribeck_friction cart + input_delay cart_drive",
        "full load_drag swing + gain_asymmetry hoist_drive",
        "full quadratic_drag hoist + spring_force cart closed",
        "locked direction_dependent_friction cart + sensor_offset psi_sensor",
        "full quadratic_drag cart + length_dependent_damping swing + direction_dependent_friction hoist",
        "full brake_zone cart",
        "locked sagging_rail cart",
        "full swing_guide swing",
        "full winch_ripple hoist",
        "full rope_layers hoist closed",
    ],
    "proof": [
        "full null",
        "full null",
        "full null closed",
        "full null closed",
        "full null closed",
        "locked null",
        "cart null",
        "pendulum null",
        "locked null closed",
        "full null wander",
        "full null wander closed",
        "full null rough",
        "cart coulomb_friction cart",
        "locked stribeck_friction cart",
        "full constant_force cart",
        "full position_direction_friction cart",
        "full quadratic_drag cart",
        "locked backlash cart closed",
        "full periodic_force cart",
        "locked presliding_friction cart",
        "cart belt_compliance cart",
        "pendulum load_drag swing",
        "full coulomb_friction swing",
        "pendulum length_dependent_damping swing",
        "full double_pendulum swing closed",
        "full position_dependent_friction hoist",
        "full stribeck_friction hoist closed",
        "full rope_elasticity hoist",
        "locked input_delay cart_drive closed",
        "full actuator_lag cart_drive",
        "full saturation cart_drive",
        "locked gain_drift cart_drive",
        "full dead_zone hoist_drive",
        "full input_delay hoist_drive closed",
        "full gain_asymmetry hoist_drive",
        "full sensor_scale x_sensor",
        "full sensor_delay psi_sensor",
        "full sensor_offset l_sensor closed",
        "full wrong_value load_mass",
        "full position_dependent_friction cart + actuator_lag cart_drive",
        "full coulomb_friction swing + drum_radius_change hoist_drive",
        "full gain_asymmetry cart_drive + sensor_offset l_sensor",
        "full periodic_force cart + quadratic_drag hoist closed",
        "full constant_force cart + load_drag swing + gain_asymmetry hoist_drive",
        "full reversal_ripple cart",
        "locked swing_friction cart",
        "full lift swing",
        "locked cubic_gain cart_drive",
        "full shared_supply hoist_drive closed",
    ],
}

SEVERITIES = (2, 5, 20)
SINGLES = {
    "cart": (
        "stribeck_friction cart", "direction_dependent_friction cart", "position_dependent_friction cart",
        "position_direction_friction cart", "quadratic_drag cart", "friction_drift cart", "spring_force cart",
        "periodic_force cart", "backlash cart", "belt_compliance cart", "input_delay cart_drive",
        "actuator_lag cart_drive", "gain_asymmetry cart_drive", "gain_drift cart_drive", "sensor_delay x_sensor",
        "missed_counts x_sensor",
    ),
    "swing": (
        "coulomb_friction swing", "load_drag swing", "wind swing", "length_dependent_damping swing",
        "double_pendulum swing", "sensor_delay psi_sensor",
    ),
    "hoist": (
        "direction_dependent_friction hoist", "position_dependent_friction hoist", "quadratic_drag hoist",
        "gain_asymmetry hoist_drive", "drum_radius_change hoist_drive", "sensor_scale l_sensor",
    ),
}  # fmt: skip
"""By the equation that feels them: 28 effects whose size can be chosen."""
AMBIGUOUS = (
    "constant_force cart", "constant_force cart", "direction_dependent_friction cart", "sensor_scale x_sensor",
    "sensor_scale psi_sensor", "sensor_offset psi_sensor", "sensor_offset psi_sensor", "input_delay hoist_drive",
)  # fmt: skip
"""Effects that have a declared equivalent."""
BEYOND = (
    "full brake_zone cart", "locked sagging_rail cart", "full swing_guide swing", "full winch_ripple hoist",
    "full rope_layers hoist", "full reversal_ripple cart", "locked swing_friction cart", "full lift swing",
    "locked cubic_gain cart_drive", "full shared_supply hoist_drive",
)  # fmt: skip
"""Laws that no catalogue has."""


def _singles(severities: tuple[int, ...] = SEVERITIES) -> list[str]:
    """Every effect at every severity, on rigs and loops in turn."""
    turns = {
        "cart": itertools.cycle(("full", "locked", "cart", "full closed", "locked closed")),
        "swing": itertools.cycle(("full", "locked", "full closed")),
        "hoist": itertools.cycle(("full", "full", "full closed")),
    }
    lines = []
    for axis, names in SINGLES.items():
        for name, severity in itertools.product(names, severities):
            flavour, *closed = next(turns[axis]).split()
            if name == "length_dependent_damping swing":  # one length would show nothing of it
                flavour = "full"
            lines.append(" ".join([flavour, name, f"at {severity}", *closed]))
    return lines


def _several(count: int, together: int) -> list[str]:
    """Effects of different equations together, each in its turn."""
    names = {axis: itertools.cycle(names[::-1] if together == 3 else names) for axis, names in SINGLES.items()}
    pairs = itertools.cycle(itertools.combinations(SINGLES, together))
    loops = itertools.cycle(("", " closed"))
    return [f"full {' + '.join(next(names[axis]) for axis in next(pairs))} at 12{next(loops)}" for _ in range(count)]


NULLS = ["full null"] * 6 + ["full null closed"] * 6 + [
    "locked null", "cart null", "pendulum null", "locked null closed", "locked null closed", "cart null closed",
    "full null wander", "full null wander", "full null wander closed", "full null wander closed",
    "locked null wander", "locked null wander closed",
]  # fmt: skip

HALVES["wide"] = [
    *_singles(),
    *_several(24, 2),
    *_several(10, 3),
    *NULLS,
    *(f"{line} at 48{closed}" for line, closed in zip(BEYOND, itertools.cycle(("", "", " closed")))),
    *(f"full {name} at 12" for name in AMBIGUOUS),
]

HALVES["fresh"] = [
    *(_singles((5, 10, 20))[3 * i + i % 3] for i in range(28)),
    "cart coulomb_friction cart", "full saturation cart_drive closed", "full rope_elasticity hoist",
    *_several(24, 2)[::5],
    *_several(10, 3)[2::5],
    *NULLS[1::2],
    *(f"{line} at 48" for line in BEYOND[1::3]),
    *(f"full {name} at 12" for name in AMBIGUOUS[2::3]),
]  # fmt: skip
"""For the method when it is done: each case once."""

CLUTTER = {
    "cart": ["rail_joints cart", "cable_bundle cart", "skewed_wheels cart", "warming_grease cart", "floor_shaking cart",
             "mains_ripple cart_drive"],
    "swing": ["worn_hinge swing", "rope_twist swing", "room_draught swing"],
    "hoist": ["drum_seams hoist", "motor_hum hoist", "dry_bearing hoist", "mains_ripple hoist_drive"],
}  # fmt: skip
"""By the axis that feels them."""
AXES = {"full": ("cart", "swing", "hoist"), "locked": ("cart", "swing"), "cart": ("cart",), "pendulum": ("swing",)}

HALVES["clutter"] = [f"full {name}" for names in CLUTTER.values() for name in names]
"""Only to size the clutter."""
RECORDED = ("recorded_force cart", "recorded_force swing", "recorded_force hoist")
HALVES["recorded"] = [f"full {name}" for name in RECORDED]
"""Only to size what recordings of real rigs leave."""

HALVES["rough"] = [
    f"{line} in clutter{closed}"
    for line, closed in zip(
        (
            "full quadratic_drag cart at 40",
            "cart direction_dependent_friction cart at 100",
            "locked position_direction_friction cart at 40",
            "full stribeck_friction cart at 40",
            "cart spring_force cart at 100",
            "full input_delay cart_drive at 40",
            "cart actuator_lag cart_drive at 100",
            "locked gain_asymmetry cart_drive at 40",
            "full constant_force cart at 100",
            "locked coulomb_friction swing at 40",
            "full load_drag swing at 40",
            "pendulum coulomb_friction swing at 100",
            "full direction_dependent_friction hoist at 100",
            "full quadratic_drag hoist at 40",
            "full gain_asymmetry hoist_drive at 40",
            "full drum_radius_change hoist_drive at 100",
            "full sensor_offset l_sensor at 40",
            "locked sensor_scale x_sensor at 40",
            "full position_dependent_friction cart + actuator_lag cart_drive at 60",
            "locked direction_dependent_friction cart + input_delay cart_drive at 60",
            "full stribeck_friction hoist + load_drag swing at 60",
            "full quadratic_drag cart + coulomb_friction swing at 60",
            "full direction_dependent_friction cart + gain_asymmetry hoist_drive + coulomb_friction swing at 60",
            "full position_direction_friction cart + stribeck_friction hoist + input_delay hoist_drive at 60",
        ),
        itertools.cycle(("", "", " closed")),
        strict=False,
    )
]
"""Like real rigs: what is concealed is large against the noise, and stands among what no law explains."""

HALVES["blind"] = [
    *(_singles((5, 10, 20))[3 * i + (i + 1) % 3] for i in range(0, 28, 2)),
    *_several(24, 2)[3::6],
    *_several(10, 3)[1::5],
    *NULLS[::4],
    *HALVES["rough"][::2],
    "full freewheeling cart_drive at 40", "full freewheeling hoist_drive at 60 in clutter",
]  # fmt: skip
"""A sample of all of these, drawn anew: one version, which is tagged, runs it once."""

HALVES["blind2"] = [
    *(_singles((5, 10, 20))[3 * i + (i + 1) % 3] for i in range(1, 28, 2)),
    *_several(24, 2)[4::6],
    *_several(10, 3)[2::5],
    *NULLS[1::4],
    *HALVES["rough"][1::2],
    "full start_delay cart_drive at 100", "full cable_drag cart at 60 in clutter",
]  # fmt: skip
"""The same of what that sample left out, for a later version."""

HALVES["hybrid"] = [line.replace("in clutter", "in recorded forces") for line in HALVES["rough"][::2]]
"""The same, where the residual forces of real rigs act in place of the clutter."""

LAWS = (
    "rod_inertia swing", "load_dependent_friction cart", "load_dependent_friction swing",
    "load_dependent_friction hoist", "cable_drag cart", "rail_inclination cart", "constant_force hoist",
    "constant_force swing", "power_law_damping swing", "torque_ripple cart_drive", "torque_ripple hoist_drive",
    "hoist_backlash hoist", "force_limit cart_drive", "force_limit hoist_drive", "speed_drive cart_drive",
    "speed_drive hoist_drive", "clock_scale clock",
)  # fmt: skip
"""What recordings of real rigs asked for; no part above has any of it."""
STARTS = ("start_delay cart_drive", "start_delay hoist_drive")
COASTS = ("freewheeling cart_drive", "freewheeling hoist_drive")
"""Laws that came after these."""
HALVES["law-sizes"] = [f"full {name}" for name in (*LAWS, *STARTS, *COASTS)]
"""Only to size them."""
for half, names, errors in (
    ("laws", LAWS, (5, 20, 60, 20, 40, 100)),
    ("starts", STARTS, (50, 200, 800, 100, 300, 1000)),
    ("coasts", COASTS, (5, 20, 60, 20, 40, 100)),
):
    HALVES[half] = [
        f"full {name} at {error}{rest}"
        for name in names
        for error, rest in zip(
            errors, ("", " closed", "", " in clutter", " in clutter closed", " in clutter"), strict=True
        )
    ]
"""Each at three sizes, clean and in clutter; a start that is late by less than some ten times the noise is late by less
than anyone would call a delay."""
HALVES["blind3"] = [
    *(_singles((5, 10, 20))[3 * i + (i + 2) % 3] for i in range(0, 28, 2)),
    *_several(24, 2)[5::6],
    *_several(10, 3)[3::5],
    *NULLS[2::4],
    *(HALVES["laws"][6 * i + i % 6] for i in range(len(LAWS))),
]
"""The other sizes, and the laws that real rigs asked for, for a third version."""
