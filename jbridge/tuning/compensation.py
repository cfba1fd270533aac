"""What a model's friction and dead zones take from its drives, for a controller to give back."""

import jax
import jax.numpy as jnp
import numpy as np

from ..control.compensation import LIMITS, Compensation
from ..errors import InputError
from ..fuzzy.membership import as_number
from ..model.effects.base import CART, CART_DRIVE, HOIST, HOIST_DRIVE, AbstractFriction
from ..model.effects.drives import DeadZone
from ..model.effects.friction import LoadDependentFriction
from ..model.files import Model
from ..model.plant import Plant

SHARE = 0.8
"""Compensating a friction in full that is smaller elsewhere would push by itself."""
_PLACES = {CART: np.linspace(0.0, 1.2, 25), HOIST: np.linspace(0.185, 0.7, 25)}
"""Where friction is averaged over [m]: the paper's rail, and its rope lengths."""


def drive_limits(model: Model) -> tuple[float, float]:
    """Commands of cart and hoist at which drives end where nobody says: in volts the paper's, otherwise the largest
    in the model's recordings.

    Raises:
        InputError: an input is not in volts, and the model does not know its recordings' range.
    """
    limits = []
    for name, usual in zip(("u_x", "u_l"), LIMITS, strict=True):
        # A rope that is locked has no drive.
        unit = model.units.get(name, "V") if name == "u_x" or model.has_hoist else "V"
        reached = model.recorded.get(name)
        most = usual if unit == "V" else max(map(abs, reached or (0.0,)))
        if not most > 0.0:
            raise InputError(
                f"{model.source or 'the model'}: {name} is in {unit}, and nothing says how many the drive takes; give "
                f"the largest commands of cart and hoist, such as --limits 255 255, or {name}_range under [recorded]"
            )
        limits.append(most)
    return limits[0], limits[1]


def compensation_for(plant: Plant, share: float = SHARE, limits: tuple[float, float] = LIMITS) -> Compensation:
    """The commands that dead zones and dry friction take on the average, and what holds the load.

    Args:
        plant: whose drives.
        share: of what is lost that is given back [1].
        limits: commands of cart and hoist beyond which the drives saturate, in the unit of the plant's gains.
    """
    bridge = plant.bridge
    lost = {}
    for axis, site, drive, gain in (
        ("cart", CART, CART_DRIVE, bridge.cart_gain),
        ("hoist", HOIST, HOIST_DRIVE, bridge.hoist_gain),
    ):
        zones = [e for e in plant.effects if isinstance(e, DeadZone) and e.site == drive]
        dead = sum(0.5 * float(zone.positive + zone.negative) for zone in zones)
        lost[axis] = share * (dead + _dry_friction(plant, site) / float(gain))
    bias = -float(bridge.load_mass * bridge.gravity / bridge.hoist_gain)
    blur = Compensation().blur * limits[0] / LIMITS[0]
    return Compensation(*map(as_number, (lost["cart"], lost["hoist"], bias, blur, *limits)))


def _dry_friction(plant: Plant, site: str) -> float:
    """What it takes to begin sliding, on the average over places and directions [N]."""
    laws = [effect for effect in plant.effects if isinstance(effect, AbstractFriction) and effect.site == site]
    still, places = jnp.zeros(()), jnp.asarray(_PLACES[site])
    both = [jnp.stack(jax.vmap(lambda q, law=law: law.levels(still, q, still, still))(places)) for law in laws]
    # Friction that grows with the drive's force takes a share of what is given.
    share = sum(float(law.share) for law in laws if isinstance(law, LoadDependentFriction))
    return sum((float(jnp.mean(levels)) for levels in both), start=0.0) / (1.0 - share)
