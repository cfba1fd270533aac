"""Which recordings of which rig are diagnosed, with which model and sidecars."""

from dataclasses import dataclass

AAU, UW, GANTRY = "cart_pendulum_aau", "pendulum_multiarm_uw", "gantry_crane_napitupulu"
RIGS = (AAU, UW, GANTRY)

SOURCES = {
    AAU: "N. Skov Vestergaard, master thesis, Aalborg University 2019, GitHub nielsSkov/masterThesisMatlab at 0e2c725",
    UW: "K. Kaheman et al., arXiv 2205.06231 (2022), GitHub dynamicslab/MultiArm-Pendulum at e99a7e1 (MIT, "
    "Copyright (c) 2022 dynamicslab)",
    GANTRY: "C. Napitupulu et al., GitHub Cristian-Napitupulu/gantry_crane_model_optimizer at dc22e97",
}


@dataclass(frozen=True)
class Piece:
    """One recording: a file, the sidecar that cuts it, and what the piece is called."""

    file: str
    sidecar: str
    name: str = ""
    every: int = 1
    """Keeps every n-th row, where the log is much faster than the motion."""


@dataclass(frozen=True)
class Case:
    """One diagnosis."""

    name: str
    rig: str
    model: str
    train: tuple[Piece, ...]
    holdout: tuple[Piece, ...]
    published: str
    """What the source says of its model's error or of what it lacks."""


def _cart(names: str) -> tuple[Piece, ...]:
    return tuple(Piece(f"cart_{name}.csv", "recordings.toml") for name in names.split())


def _pieces(file: str, stem: str, numbers: range, every: int) -> tuple[Piece, ...]:
    return tuple(Piece(f"{file}.csv", f"{stem}{i}.toml", f"{file}, piece {i}", every) for i in numbers)


def runs(axis: str, levels: tuple[int, ...], runs: tuple[int, ...], sidecar: str = "") -> tuple[Piece, ...]:
    return tuple(
        Piece(f"{axis}_pwm{level}_run{run}.csv", sidecar or f"{axis}.toml") for level in levels for run in runs
    )


CART_TRAIN = _cart("sweep_to0p3 sweep_to0p6 osc_x0p05 osc_x0p11 osc_x0p20 osc_x0p32 osc_x0p44 osc_x0p56 osc_x0p68")
CART_HOLDOUT = _cart("sweep_to0p5 osc_x0p14 osc_x0p38 osc_x0p62")

CART_MAP_TRAIN = _cart(
    "sweep_to0p3 sweep_to0p6 osc_x0p05 osc_x0p08 osc_x0p11 osc_x0p17 osc_x0p20 osc_x0p23 osc_x0p26 osc_x0p29 osc_x0p35"
    " osc_x0p41 osc_x0p47 osc_x0p53 osc_x0p59 osc_x0p65 osc_x0p71"
)
CART_MAP_HOLDOUT = CART_HOLDOUT

CASES = (
    Case(
        "cart",
        AAU,
        "cart.toml",
        CART_TRAIN,
        CART_HOLDOUT,
        "friction by place and direction, 1.9 to 5.6 N (table); viscous part negligible; mass 6.28 kg",
    ),
    Case(
        "pendulum 1",
        AAU,
        "pendulum1.toml",
        _pieces("pendulum1_free_decay", "pendulum1-piece", range(1, 4), 2),
        _pieces("pendulum1_free_decay", "pendulum1-piece", range(4, 5), 2),
        "Coulomb friction 4.1e-3 N m in the joint; 60 s open loop 0.155 rad with it, 1.42 rad with damping alone",
    ),
    Case(
        "pendulum 2",
        AAU,
        "pendulum2.toml",
        _pieces("pendulum2_free_decay", "pendulum2-piece", range(1, 4), 2),
        _pieces("pendulum2_free_decay", "pendulum2-piece", range(4, 5), 2),
        "Coulomb friction 5.67e-3 N m in the joint",
    ),
    Case(
        "pendulum",
        UW,
        "pendulum.toml",
        # A law of friction shows where the swing is small, so the small swing is among what is learned from.
        (
            *_pieces("single_free_swing_paramest", "piece", range(1, 5), 2),
            Piece("single_free_swing.csv", "small.toml", "single_free_swing", 2),
        ),
        _pieces("single_free_swing_paramest", "piece", range(5, 7), 2),
        "damping alone; validation pieces 0.0147 and 0.0206 rad; the small swing does not stop",
    ),
    Case(
        "trolley",
        GANTRY,
        "trolley-model.toml",
        runs("trolley", (675, 725), (1, 2)),
        runs("trolley", (675, 725), (3,)),
        "viscous damping and a 3 V threshold; x 0.84 / 1.05 m (675), 0.12 / 0.13 m (725), FPA / SGD",
    ),
    Case(
        "hoist",
        GANTRY,
        "hoist-model.toml",
        runs("hoist", (225, 300), (1, 2)),
        runs("hoist", (225, 300), (3,)),
        "viscous damping and a 3 V threshold; l 0.271 / 0.270 m (225), 0.019 m (300), FPA / SGD",
    ),
)

LEVELS = {"trolley": (600, 625, 650, 675, 700, 725, 750), "hoist": (200, 225, 250, 275, 300, 325)}

PUBLISHED = {
    ("trolley", 600): {"x": (1.89, 2.05), "psi": (0.025, 0.015)},
    ("trolley", 625): {"x": (1.92, 2.09), "psi": (0.027, 0.020)},
    ("trolley", 650): {"x": (1.60, 1.78), "psi": (0.033, 0.024)},
    ("trolley", 675): {"x": (0.84, 1.05), "psi": (0.032, 0.027)},
    ("trolley", 700): {"x": (0.38, 0.56), "psi": (0.044, 0.039)},
    ("trolley", 725): {"x": (0.12, 0.13), "psi": (0.072, 0.076)},
    ("trolley", 750): {"x": (0.29, 0.21), "psi": (0.098, 0.101)},
    ("hoist", 200): {"l": (0.264, 0.263)},
    ("hoist", 225): {"l": (0.271, 0.270)},
    ("hoist", 250): {"l": (0.079, 0.079)},
    ("hoist", 275): {"l": (0.026, 0.026)},
    ("hoist", 300): {"l": (0.019, 0.019)},
    ("hoist", 325): {"l": (0.012, 0.012)},
}
"""RMSE of the published model over 15 s, mean of three runs, with its two parameter sets (FPA, SGD)."""

PUBLISHED_MOTOR_ON = {700: (0.24, 0.20), 725: (0.08, 0.13), 750: (0.15, 0.22)}
"""The same for x [m] while the motor is on, where the source's README gives it."""
