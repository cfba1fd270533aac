"""What quantities, sites, kinds of effects and numbers are called before a rig's owner."""

QUANTITIES = {
    "x": ("cart position", "m"),
    "psi": ("swing angle", "rad"),
    "l": ("rope length", "m"),
    "v_x": ("cart velocity", "m/s"),
    "v_psi": ("swing rate", "rad/s"),
    "v_l": ("rope velocity", "m/s"),
    "u_x": ("cart drive's input", ""),
    "u_l": ("hoist drive's input", ""),
    "t": ("time since the recording's start", "s"),
}
"""Name and SI unit of each quantity that a recording shows; an input's unit is the recording's."""

_SITES = {
    "cart": "cart",
    "swing": "swing",
    "hoist": "hoist",
    "cart_drive": "cart drive",
    "hoist_drive": "hoist drive",
    "x_sensor": "cart position sensor",
    "psi_sensor": "angle sensor",
    "l_sensor": "rope length",  # no sensor where it was measured once, by hand
    "clock": "clock of the recordings",
}
_KINDS = {
    "coulomb_friction": "Coulomb friction",
    "stribeck_friction": "Stribeck friction",
    "direction_dependent_friction": "direction-dependent friction",
    "position_dependent_friction": "position-dependent friction",
    "position_direction_friction": "position- and direction-dependent friction",
    "load_dependent_friction": "load-dependent friction",
    "length_dependent_damping": "length-dependent damping",
    "power_law_damping": "power-law damping",
}
"""Kinds that need more than blanks between their words."""


def quantity_name(quantity: str) -> str:
    return QUANTITIES[quantity][0] if quantity in QUANTITIES else spaced(quantity)


def site_name(site: str | None) -> str:
    """A site in words; a wrong value's site is the parameter's name."""
    if site is None:
        return "no single place"
    return _SITES.get(site, spaced(site))


def kind_name(kind: str) -> str:
    return _KINDS.get(kind, spaced(kind))


def explanation_name(kind: str, site: str) -> str:
    """An explanation within a sentence.

    >>> explanation_name("dead_zone", "cart_drive"), explanation_name("wrong_value", "load_mass")
    ('dead zone at the cart drive', 'a wrong value of the load mass')
    """
    if kind == "wrong_value":
        return f"a wrong value of the {spaced(site)}"
    return f"{kind_name(kind)} at the {site_name(site)}"


def number_name(name: str) -> str:
    """A number of a model within a sentence.

    >>> number_name("cart_gain"), number_name("coulomb_friction@cart.level")
    ('cart gain', 'level of the Coulomb friction at the cart')
    """
    if "@" not in name:
        return spaced(name)
    owner, _, key = name.rpartition(".")
    kind, _, site = owner.partition("@")
    return f"{spaced(key)} of the {explanation_name(kind, site.split('#')[0])}"


def spaced(key: str) -> str:
    return key.replace("_", " ")
