"""What a hold-out must say of an effect for it to be confirmed."""

import numpy as np
import pytest
from scipy.stats import norm, ttest_1samp

from jbridge.diagnosis.structures.space import make_space
from jbridge.diagnosis.structures.structure import Structure, base_structure, steadiness, weighed
from jbridge.diagnosis.validation.confirmation import check_effect
from jbridge.diagnosis.validation.holdout import HoldOut
from jbridge.diagnosis.validation.validate import validate
from jbridge.identification.data.windows import make_data
from jbridge.identification.estimation import fit_structure, make_problem
from jbridge.identification.evaluation.errors import Evaluation
from jbridge.identification.setting import make_setting
from jbridge.model.files import Model
from tests.identification.cases import play, steps
from tests.problems import NUMBERS, make_plant

DRAG = ("quadratic_drag", "cart")


class Run(Evaluation):
    """Errors at one horizon, in units of each channel's noise; the cart's is a thousandth of the swing's.

    Besides those of most windows there are those of one that no model meets, and the cart's at other horizons.
    """

    def __init__(self, x, psi=0.0, *, unmet=0.0, others=None):
        object.__setattr__(self, "most", {1.0: {"x": x, "psi": psi}} | {h: {"x": x} for h, x in (others or {}).items()})
        object.__setattr__(self, "total", {"x": x + unmet, "psi": psi})

    @property
    def horizons(self):
        return tuple(sorted(self.most))

    def ratios(self, horizon):
        return {axis: np.sqrt(1.0 + total) for axis, total in self.total.items()}

    def typical_excess(self, horizon):
        return self.most[horizon]

    def excess(self, horizon):
        return {"x": 1e-6 * self.total["x"], "psi": self.total["psi"]}


def in_channel(losses, channel):
    """Losses by block, all in one channel."""
    out = np.zeros((len(losses), 3))
    out[:, channel] = losses
    return out


def test_steadiness_is_that_of_noise_or_of_a_t_test():
    def of_equals(gain):
        return steadiness(gain, np.ones(len(gain)))

    # As steady as noise: the root of a likelihood ratio.
    assert of_equals(np.full(6, 0.4)) == pytest.approx(np.sqrt(2 * 6 * 0.4))
    assert of_equals(np.full(6, -0.4)) == pytest.approx(-np.sqrt(2 * 6 * 0.4))
    # Where blocks scatter more, what SciPy's test of their mean says.
    root = np.random.default_rng(0).normal(0.5, 4.0, 400)
    said = ttest_1samp(root, 0.0, alternative="greater").pvalue
    assert of_equals(0.5 * np.sign(root) * root**2) == pytest.approx(norm.isf(said), rel=0.01)
    # Two blocks that differ tell less than many.
    assert of_equals(np.array([20.0, 2.0])) < 0.6 * of_equals(np.array([20.0, 2.0] * 4))


def test_blocks_that_do_not_excite_an_effect_say_nothing():
    gain, expected = np.array([3.0, 1.0, 2.0]), np.array([4.0, 1.0, 1.0])
    alone = steadiness(gain, expected)
    assert steadiness(np.append(gain, [0.01, -0.01]), np.append(expected, [0.0, 0.0])) == pytest.approx(alone)
    # A regression on the roots of what is expected, as steady as noise.
    gain, expected = np.tile(0.1 * gain, 8), np.tile(expected, 8)
    root = np.sqrt(2.0 * expected)
    slope = np.linalg.lstsq(root[:, None], np.sqrt(2.0 * gain), rcond=None)[0][0]
    assert steadiness(gain, expected) == pytest.approx(slope * np.linalg.norm(root))
    # Where blocks scatter more, blocks of one weight among others that tell nothing are as those alone.
    root = np.random.default_rng(1).normal(0.5, 4.0, 60)
    scattered = 0.5 * np.sign(root) * root**2
    alone = steadiness(scattered, np.ones(60))
    assert alone < 0.5 * np.sqrt(60 * 0.5**2)
    assert steadiness(np.append(scattered, 30 * [5.0]), np.append(np.ones(60), np.zeros(30))) == pytest.approx(alone)


@pytest.mark.parametrize(
    ("back", "left", "losses", "status"),
    [
        (90.0, 10.0, [40.0, 60.0, 50.0], "confirmed"),
        (12.0, 10.0, [40.0, 60.0, 50.0], "confirmed"),
        (8.0, 10.0, [40.0, 60.0, 50.0], "suggested"),  # what is left could be what it imitates
        (0.5, 0.1, [4.0, 6.0, 5.0], "confirmed"),  # little, and nothing is left
        (90.0, 10.0, [40.0, -60.0, 1.0], "suggested"),  # in one block better, in another one worse
    ],
)
def test_an_effect_is_confirmed_by_steady_gains_above_what_has_no_name(back, left, losses, status):
    found = check_effect(DRAG, in_channel(losses, 0), np.ones(3), Run(100.0), Run(left), Run(left + back))
    assert found.status == status
    assert found.explained == pytest.approx(back / max(100.0, left + back))


@pytest.mark.parametrize(("back", "status"), [(80.0, "confirmed"), (10.0, "suggested")])
def test_what_has_no_name_in_one_channel_speaks_against_nothing_in_another(back, status):
    """The cart's error is 100 times larger in units of its noise, and hardly changes."""
    before, after, without = Run(1e6, 100.0), Run(9e5, 20.0), Run(9e5, 20.0 + back)
    found = check_effect(DRAG, in_channel([40.0, 60.0, 50.0], 1), np.ones(3), before, after, without)
    assert found.status == status
    assert found.explained == pytest.approx(0.5 * back / 100.0)


def test_an_effect_is_judged_in_the_channel_in_which_it_matters():
    """The cart's error is large and has no name; the swing's hardly exceeds the noise, and the effect closes it."""
    before, after, without = Run(1e6, 0.9), Run(9e5, 0.1), Run(9e5, 0.8)
    for channel, status in ((0, "suggested"), (1, "confirmed")):
        assert (
            check_effect(DRAG, in_channel([40.0, 60.0, 50.0], channel), np.ones(3), before, after, without).status
            == status
        )


@pytest.mark.parametrize(("back", "status"), [(30.0, "confirmed"), (15.0, "suggested")])
def test_one_channel_in_which_an_effect_is_more_than_what_has_no_name_will_do(back, status):
    """The swing loses a little more by the criterion, and keeps most of its error."""
    losses = in_channel([4.0, 6.0, 5.0], 0) + in_channel([4.0, 6.0, 6.0], 1)
    found = check_effect(DRAG, losses, np.ones(3), Run(100.0, 100.0), Run(20.0, 50.0), Run(20.0 + back, 60.0))
    assert found.status == status


def test_a_window_that_no_model_meets_has_no_say():
    before, after, without = (Run(x, unmet=1e3) for x in (100.0, 10.0, 90.0))
    assert (
        check_effect(DRAG, in_channel([40.0, 60.0, 50.0], 0), np.ones(3), before, after, without).status == "confirmed"
    )


@pytest.mark.parametrize(
    ("without", "status"),
    [
        ({0.3: 10.0, 1.0: 16.0, 3.0: 60.0}, "confirmed"),  # a wrong length shows in long windows
        ({0.3: 10.0, 1.0: 24.0, 3.0: 10.0}, "suggested"),  # what helps at one horizon alone imitates something else
    ],
)
def test_an_effect_is_judged_by_all_horizons(without, status):
    before, after = (Run(x, others={0.3: x, 3.0: x}) for x in (100.0, 10.0))
    left_out = Run(without.pop(1.0), others=without)
    assert check_effect(DRAG, in_channel([40.0, 60.0, 50.0], 0), np.ones(3), before, after, left_out).status == status


def test_where_nothing_exceeds_the_noise_steadiness_alone_decides():
    found = check_effect(DRAG, in_channel([40.0, 60.0, 50.0], 0), np.ones(3), Run(0.5), Run(0.1), Run(0.4))
    assert found.status == "confirmed" and found.explained is None


def test_what_happened_once_is_an_event():
    found = check_effect(
        ("missed_counts", "x_sensor"), in_channel([-1.0, 0.0, 0.0], 0), np.ones(3), Run(100.0), Run(1.0), Run(1.0)
    )
    assert found.status == "event"


def validated(plants, effects):
    """A cart's recordings, the last two held out, after a fit of some effects of one number each to the others."""
    runs = [
        play(plant, np.stack([steps(500, i), np.zeros(500)], axis=1), name=f"run-{i}.csv", start={"x": 0.6}, seed=i)
        for i, plant in enumerate(plants)
    ]
    known = frozenset({"cart_mass", "cart_gain"})
    model = Model(make_plant(), known, frozenset(NUMBERS), {}, "m.toml")
    train, sealed = runs[:3], HoldOut(runs[3:])
    setting = make_setting(model, train, runs[3:])
    problem = make_problem(setting, make_data(train))
    problem, given = fit_structure(problem, model.plant, known)
    base = base_structure(problem, make_space(problem, model.plant, known, shared=False), given.point)
    problem, every = fit_structure(problem, make_plant(*effects), known)
    space = make_space(problem, every.plant, known, shared=False)
    keys = {(kind, site): tuple(values) for kind, site, values in effects}
    found = Structure(space=space, names=tuple(keys), keys=keys, choices=dict.fromkeys(keys, 0.0), point=every.point)
    return validate(problem, base, weighed(problem, found), sealed, lambda text: None)


@pytest.mark.slow
def test_what_gains_on_its_own_recordings_alone_is_no_part_of_the_model():
    """Dry friction, and a force that pushed in one of the recordings alone, both fitted to all recordings."""
    friction = ("coulomb_friction", "cart", {"level": 4.0})
    pushed = ("constant_force", "cart", {"level": 2.0})
    checked = validated(
        [make_plant(friction), make_plant(friction, pushed), *3 * [make_plant(friction)]], [friction, pushed]
    )
    assert {c.name: c.status for c in checked.checked} == {
        ("coulomb_friction", "cart"): "confirmed",
        ("constant_force", "cart"): "suggested",
    }
    assert checked.final.names == (("coulomb_friction", "cart"),)
    assert [effect.kind for effect in checked.final.plant.effects] == ["coulomb_friction"]
    assert checked.after.errors(1.0)["x"] < 0.2 * checked.before.errors(1.0)["x"]
    assert checked.verdict[0] == "missing_physics"


@pytest.mark.slow
def test_of_two_effects_of_which_either_would_do_one_is_confirmed():
    late = [("input_delay", "cart_drive", {"delay": 0.05}), ("sensor_delay", "x_sensor", {"delay": 0.03})]
    checked = validated(5 * [make_plant(late[0])], late)
    assert sorted(c.status for c in checked.checked) == ["confirmed", "suggested"]
    assert checked.verdict[0] == "missing_physics" and checked.explained["x"] > 0.9
