"""The verdict as a rig's owner reads it."""

import pytest

from jbridge.diagnosis.result import Channel, Location, NamedEffect
from jbridge.diagnosis.words import verdict_sentence
from jbridge.identify.result import Estimate

AT_CART = Location("cart", "cart", {"cart": 1.0}, (), ())
BEFORE, AFTER = {"x": Channel(2e-3, 1e-4)}, {"x": Channel(1.1e-4, 1e-4)}
FRICTION = NamedEffect("coulomb_friction", "cart", 1.0, {}, (), "")
MASS = NamedEffect("wrong_value", "load_mass", 1.0, {"value": Estimate(0.2, 0.01, 0.18, 0.22, "kg")}, (), "")


def said(verdict, effects=(), after=AFTER, *, large=True, curve=False, unproven=None):
    return verdict_sentence(verdict, effects, AT_CART, BEFORE, after, large, curve=curve, unproven=unproven)


@pytest.mark.parametrize(
    ("sentence", "wanted"),
    [
        (said("adequate", large=False), "The model explains the recordings: what remains is noise"),
        (said("adequate"), "errors reach 20 times the noise in the cart position, but they do not repeat"),
        (
            said("missing_physics", [FRICTION]),
            "The model lacks physics: coulomb friction at the cart. With it the error falls from 20 to 1.1 times",
        ),
        (
            said("missing_physics", [MASS]),
            "A known number is wrong: the load mass, which comes out as 0.2 ± 0.02 kg. With it the error falls",
        ),
        (
            said("missing_physics", [FRICTION, MASS]),
            "coulomb friction at the cart and the load mass, which comes out as 0.2 ± 0.02 kg. With them",
        ),
        (said("unknown", after=BEFORE), "nothing in the catalogue explains it: errors reach 20 times the noise."),
        (said("unknown", [FRICTION], BEFORE), "What was found explains a part of it only."),
        (said("unknown", after=BEFORE, curve=True), "The model file keeps the missing force as a curve"),
        (
            said("unknown", [FRICTION], unproven=15.2),
            "what explains these recordings leaves errors of 15 times the noise on the hold-out.",
        ),
    ],
)
def test_verdicts_read_as_sentences(sentence, wanted):
    assert wanted in sentence and sentence.endswith(".")
