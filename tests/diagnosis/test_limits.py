"""How large an effect may be that was not named: its bound covers it, and what cannot be seen is said to be so."""

import numpy as np
import pytest

from jbridge.diagnosis.candidates import Candidate
from jbridge.diagnosis.limits import _of_finite, _of_null, not_seen
from jbridge.diagnosis.looks import Look
from jbridge.diagnosis.responses import magnitude, with_weaker
from jbridge.diagnosis.search import Search, state_of
from jbridge.identification.problem import make_setting, resolve
from jbridge.identify.base import base_fit
from jbridge.model.parameters import ParameterTable
from tests.diagnosis.test_diagnose import model, rig
from tests.problems import make_plant

GIVEN = ParameterTable(make_plant())


def seen(kind, site, values, free, estimate, std, *, change=1.0, finite=False, taken_up=False, response=10.0):
    """A look at one number with a given estimate."""
    candidate = Candidate(kind, site, values, free, finite)
    return Look(
        candidate,
        ("",) if finite else free[:1],
        np.array([estimate]),
        np.array([[std**2]]),
        np.array([taken_up]),
        np.array([response]),
        np.full((3, 1, 1), change**2),
    )


def test_a_bound_is_the_estimate_and_twice_the_widened_deviation():
    (row,) = _of_null([seen("constant_force", "cart", {}, ("level",), -0.3, 0.1, change=2.0)], {}, GIVEN)
    assert (row.kind, row.site, row.parameter, row.unit) == ("constant_force", "cart", "level", "N")
    assert row.limit == pytest.approx(0.3 + 1.96 * 0.2, rel=1e-3)  # deviations are doubled everywhere here
    assert row.change == pytest.approx(2.0 * row.limit, rel=1e-6)
    assert not row.notable and "practically nothing" in row.statement


def test_what_cannot_be_negative_is_bounded_from_nothing():
    (row,) = _of_null([seen("quadratic_drag", "cart", {}, ("coefficient",), -5.0, 1.0)], {}, GIVEN)
    assert row.limit == pytest.approx(1.96 * 2.0, rel=1e-3)
    assert row.notable and "may matter" in row.statement


def test_what_is_taken_up_has_no_limit():
    (row,) = _of_null([seen("sensor_offset", "x_sensor", {}, ("offset",), 0.0, 1.0, taken_up=True)], {}, GIVEN)
    assert row.limit is None and row.change is None and row.notable
    assert row.statement.startswith("Could not have been seen in these recordings")


def test_a_phase_takes_both_of_its_parts():
    """An amplitude of 5 at a phase between sine and cosine shows as 3 and 4."""
    values = {"amplitude": 0.0, "period": 0.1, "phase": 0.0}
    wave = Candidate("periodic_force", "cart", values, tuple(values), False, ("amplitude", "phase"))
    change = np.array([np.diag([4.0, 1.0])] * 3)
    twice = np.full(2, 10.0)
    both = np.array([3.0, 4.0]), 1e-18 * np.eye(2), np.zeros(2, bool)
    (row,) = _of_null([Look(wave, ("amplitude", "amplitude"), *both, twice, change)], {}, GIVEN)
    # A quarter of a percent of the value is added to every deviation.
    assert row.limit == pytest.approx(5.0, rel=1e-2)
    assert row.change == pytest.approx(2.0 * row.limit, rel=1e-6)  # at its worst phase


def backlash(gap, amplitude, std, response=10.0):
    values = {"gap": gap, "motor_mass": 1.0, "encoder": "cart"}
    return seen("backlash", "cart", values, ("gap", "motor_mass"), amplitude, std, finite=True, response=response)


def test_the_weakest_excluded_seed_is_the_limit():
    looks = [backlash(3e-3, 0.0, 0.01, 90.0), backlash(1e-3, 0.0, 0.05, 30.0), backlash(1e-4, 0.0, 0.4, 3.0)]
    row = _of_finite(looks, {})
    # At 0.1 mm the bound of 1.96 x 2 x 0.4 does not exclude that the whole play is there.
    assert row.limit == 1e-3 and row.unit == "m"
    assert row.change == pytest.approx(1.96 * 2 * 0.05, rel=1e-2) and not row.notable
    assert "1 mm or more would have shown" in row.statement and "encoder cart" in row.statement


def test_without_an_excluded_seed_there_is_no_limit():
    row = _of_finite([backlash(3e-3, 0.9, 0.2), backlash(1e-3, 0.0, 0.7, 3.0)], {})
    assert row.limit is None and row.notable
    silent = _of_finite([backlash(3e-3, 0.0, 1e-3, response=0.0)], {})
    assert silent.limit is None


def test_weaker_seeds_lead_to_absence():
    belt = [
        Candidate("belt_compliance", "cart", {"stiffness": s, "encoder": e}, ("stiffness",), True)
        for e in ("cart", "motor")
        for s in (2e3, 1.2e4)
    ]
    assert magnitude(belt) == "stiffness"
    for encoder in ("cart", "motor"):
        own = [c.values["stiffness"] for c in with_weaker(belt) if c.values["encoder"] == encoder]
        assert sorted(own) == [2e3, 1.2e4, 3.6e4, 1.08e5, 3.24e5]
    play = [Candidate("backlash", "cart", {"gap": g}, ("gap",), True) for g in (7e-4, 3e-3)]
    assert min(c.values["gap"] for c in with_weaker(play)) == pytest.approx(7e-4 / 27)
    stop = [Candidate("end_stop", "cart", {"position": p}, ("position",), True) for p in (0.9, 0.8)]
    assert with_weaker(stop) == stop


def limits(runs):
    """Limits by kind and site for the cart's model, fitted to runs whose last is the hold-out."""
    own = model()
    setting = make_setting(own, runs[:-1], runs[-1:])
    plant = resolve(own.plant, setting.length)
    base = base_fit(plant, own.known, setting)
    search = Search(plant, own.known, setting, None)
    rows = not_seen(search, state_of(base.engine, base.free_run, base.fits, own.known))
    return {(row.kind, row.site, row.parameter): row for row in rows}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "parameter"),
    [
        (("quadratic_drag", "cart", {"coefficient": 0.01}), "coefficient"),
        (("constant_force", "cart", {"level": 1e-4}), "level"),
        (("sensor_offset", "x_sensor", {"offset": 0.05}), "offset"),
    ],
)
def test_a_small_effect_lies_below_its_limit(effect, parameter):
    kind, site, values = effect
    row = limits(rig(effect))[kind, site, parameter]
    assert row.limit is None or row.limit >= values[parameter]
    assert (row.limit is None) == (site == "x_sensor")
    if row.limit is not None:
        assert row.limit < 10 * values[parameter]  # a bound, and not just any large number


@pytest.mark.slow
def test_limits_cover_in_most_noises():
    """A drag of half its limit, hidden in eight noises: every limit covers it, and none is silly."""
    from tests.diagnosis.test_diagnose import DRY
    from tests.identify.cases import cart_recordings

    truth, covered, sizes = 0.005, 0, []
    for seed in range(8):
        plant = make_plant(DRY, ("quadratic_drag", "cart", {"coefficient": truth}), cart_damping=30.0, cart_gain=16.0)
        row = limits(cart_recordings(plant, 4, seed=10 * seed))["quadratic_drag", "cart", "coefficient"]
        covered += row.limit >= truth
        sizes.append(row.limit)
    assert covered >= 7
    assert np.median(sizes) < 20 * truth
