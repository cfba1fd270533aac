"""Candidates: everything that the recordings have the parts for, and nothing that cannot be seen."""

import numpy as np
import pytest

from jbridge.diagnosis.structures.candidates import WRONG_VALUE, Candidate, candidates
from jbridge.diagnosis.structures.space import is_apart, largest_shown
from jbridge.identification.operating_range import scene_of
from jbridge.identification.setting import Setting
from jbridge.model.effects.base import AXIS_OF_SITE
from jbridge.model.effects.catalogue import CATALOGUE, make_effect
from jbridge.model.parameters import ParameterTable
from jbridge.model.plant import Plant
from tests.identification.cases import FULL, NOISE, TIMES, make_recording
from tests.problems import make_plant

KNOWN = frozenset({"cart_mass", "load_mass", "winch_mass", "gravity"})


def setting_of(*channels: str) -> Setting:
    run = make_recording("run.csv", TIMES, **{key: FULL[key] for key in channels})
    there = {"x": run.has_cart, "psi": run.has_swing, "l": run.has_hoist}
    axes = tuple(axis for axis in there if there[axis])
    noise = {axis: NOISE[axis] for axis in ("x", "psi", "l") if axis in channels}
    return Setting((run,), noise, axes, run.units, 0.6)


def found_for(setting: Setting, plant: Plant) -> list[Candidate]:
    return candidates(plant, KNOWN, setting, scene_of(setting, plant))


def test_every_known_number_but_gravity_may_be_wrong():
    setting = setting_of(*FULL)
    known = {*KNOWN, "cart_gain", "cart_damping", "swing_damping", "hoist_damping", "hoist_gain"}
    found = candidates(make_plant(), known, setting, scene_of(setting, make_plant()))
    assert {c.site for c in found if c.kind == WRONG_VALUE} == known - {"gravity"}


def test_a_whole_bridge_has_a_candidate_for_every_kind_and_site():
    names = {c.name for c in found_for(setting_of(*FULL), make_plant())}
    wanted = {(kind, site) for kind, cls in CATALOGUE.items() for site in cls.sites if not cls.beside}
    wanted -= {("sensor_offset", "x_sensor")}  # where x is 0 is a matter of choice
    assert names == wanted | {(WRONG_VALUE, number) for number in ("cart_mass", "load_mass", "winch_mass")}


@pytest.mark.parametrize(
    ("channels", "axes"),
    [
        (("u_x", "x"), {"x"}),
        (("u_x", "x", "psi"), {"x", "psi"}),
        (("psi",), {"psi"}),
    ],
    ids=["cart", "locked rope", "pendulum"],
)
def test_parts_that_are_absent_have_none(channels, axes):
    found = found_for(setting_of(*channels), make_plant())
    effects = {c.name for c in found if c.kind != WRONG_VALUE}
    assert {AXIS_OF_SITE[site] for _, site in effects} - {"l"} == axes
    # Of the hoist only the length's sensor stays: on a locked rope it tells another length.
    assert {site for _, site in effects if AXIS_OF_SITE[site] == "l"} == ({"l_sensor"} if "psi" in axes else set())
    numbers = {c.site for c in found if c.kind == WRONG_VALUE}
    assert numbers == {n for n, a in (("cart_mass", "x"), ("load_mass", "psi"), ("winch_mass", "l")) if a in axes}


def test_what_the_model_has_is_no_candidate():
    plant = make_plant(
        ("coulomb_friction", "cart", {"level": 3.0}), ("dead_zone", "cart_drive", {"positive": 0.2, "negative": 0.2})
    )
    names = {c.name for c in found_for(setting_of(*FULL), plant)}
    assert ("coulomb_friction", "cart") not in names and ("dead_zone", "cart_drive") not in names
    assert ("coulomb_friction", "hoist") in names and ("dead_zone", "hoist_drive") in names


def test_what_repeats_does_so_twice_in_what_was_recorded_and_no_width_is_beyond_the_inputs():
    """The cart goes from 0.5 + 0.2 sin(3.99) to 0.7 m."""
    longest = largest_shown(found_for(setting_of(*FULL), make_plant()))
    assert {name.split("@")[0] for name in longest} == {
        "sensor_eccentricity", "torque_ripple", "periodic_force", "freewheeling"
    }  # fmt: skip
    span = 0.2 - 0.2 * np.sin(TIMES[-1])
    for name in ("sensor_eccentricity@x_sensor", "torque_ripple@cart_drive", "periodic_force@cart"):
        assert longest[f"{name}.period"] == pytest.approx(0.5 * span, rel=1e-6)


def test_an_angles_error_repeats_with_the_turn_of_its_disc():
    found = [c for c in found_for(setting_of(*FULL), make_plant()) if c.name == ("sensor_eccentricity", "psi_sensor")]
    turns = [2 * np.pi / c.values["period"] for c in found]
    assert 1.0 in turns and np.allclose(turns, np.round(turns)), "a whole number of times in a turn"
    assert all("period" not in c.free and c.harmonic for c in found), "the turn is known, amplitude and phase are not"


def test_a_bridge_has_one_drive_train():
    belt = make_effect("belt_compliance", "cart", {"stiffness": 2e4, "damping": 20.0, "motor_mass": 2.0})
    names = {c.kind for c in found_for(setting_of(*FULL), make_plant(belt))}
    assert not names & {"belt_compliance", "backlash"}


def test_numbers_that_are_not_known_are_no_rivals():
    setting, plant = setting_of(*FULL), make_plant()
    found = candidates(plant, frozenset({"gravity", "load_mass"}), setting, scene_of(setting, plant))
    assert {c.site for c in found if c.kind == WRONG_VALUE} == {"load_mass"}


@pytest.mark.parametrize("candidate", found_for(setting_of(*FULL), make_plant()), ids=lambda c: "-".join(c.name))
def test_a_candidate_can_be_put_into_a_model(candidate):
    if candidate.kind == WRONG_VALUE:
        table = ParameterTable(make_plant())
        assert table.entry(int(candidate.places(table)[0])).name == candidate.site
        return
    own = {key: value for key, value in candidate.values.items() if key != "coulomb"}
    effect = make_effect(candidate.kind, candidate.site, own)
    plant = make_plant(effect)
    table = ParameterTable(plant)
    places = candidate.places(table)
    assert len(places) and table.fitted()[places].all()
    null = np.array(table.ravel(make_plant(make_effect(candidate.kind, candidate.site, own))))
    vector = candidate.set(table, null)
    np.testing.assert_allclose(vector, null)
    # Seeds start within the bounds of physics.
    low, high = table.bounds()
    assert np.all(vector[places] >= low[places]) and np.all(vector[places] <= high[places])


@pytest.mark.parametrize(
    ("kind", "site", "free", "linear", "sizes"),
    [
        ("missed_counts", "x_sensor", ("jump", "time"), ("jump",), ("jump",)),
        ("periodic_force", "cart", ("amplitude", "period", "phase"), ("amplitude", "phase"), ("amplitude",)),
        ("stribeck_friction", "cart", ("breakaway", "velocity"), ("breakaway", "velocity"), ("breakaway",)),
        ("stribeck_friction", "cart", *2 * (("level", "breakaway", "velocity"),), ("level", "breakaway")),
        ("direction_dependent_friction", "cart", *3 * (("positive", "negative"),)),
        ("end_stop", "cart", ("position", "stiffness", "damping"), (), ("stiffness", "damping")),
        ("position_direction_friction", "cart", *3 * (("positive", "negative"),)),
        ("backlash", "cart", ("gap", "motor_mass"), (), ("gap", "motor_mass")),
        ("wrong_value", "load_mass", *3 * (("load_mass",),)),
    ],
)
def test_what_says_how_large_an_explanation_is(kind, site, free, linear, sizes):
    """Neither when a sensor jumped nor where a wave begins tells that it is there."""
    assert Candidate(kind, site, {}, free, not linear, linear).sizes == sizes


@pytest.mark.parametrize("kind", [kind for kind, cls in CATALOGUE.items() if cls.beside])
def test_some_are_proposed_beside_others_alone(kind):
    """And then in a program of their own, so that searches without these others never compile them."""
    for site in CATALOGUE[kind].sites:
        plant = make_plant((CATALOGUE[kind].beside[0], site, {}))
        assert {name for name in (c.name for c in found_for(setting_of(*FULL), plant)) if name[0] == kind} == {
            (kind, site)
        }
    assert is_apart(kind) and not is_apart("actuator_lag")
