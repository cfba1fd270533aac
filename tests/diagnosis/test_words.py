"""The verdict as a rig's owner reads it."""

import dataclasses

import pytest

from jbridge.diagnosis.holdout import OffMap
from jbridge.diagnosis.once import Once
from jbridge.diagnosis.result import Channel, Interval, Likeness, Location, NamedEffect, Rival
from jbridge.diagnosis.words import Elsewhere, Proof, effect_sentence, verdict_sentence
from jbridge.identify.result import Estimate

AT_CART = Location("cart", "cart", {"cart": 1.0}, (), ())
BEFORE, AFTER = {"x": Channel(2e-3, 1e-4)}, {"x": Channel(1.1e-4, 1e-4)}
FRICTION = NamedEffect("coulomb_friction", "cart", 1.0, {}, (), "")
MASS = NamedEffect("wrong_value", "load_mass", 1.0, {"value": Estimate(0.2, 0.01, 0.18, 0.22, "kg")}, (), "")


LIKE_FRICTION = Likeness(0.7, {"x": 0.7}, 0.95, -1.0, None, 0.0, "The missing force takes energy out.")
AS_FRICTION = dataclasses.replace(AT_CART, likeness=LIKE_FRICTION)


def said(verdict, effects=(), after=AFTER, *, unproven=False, at=AT_CART, **other):
    proof = Proof(30.0, 15.2, "windows of 2 s") if unproven else Proof(30.0, 1.2, "free runs")
    told = {"large": True, "asked": True, "curve": False, "unproven": unproven} | other
    return verdict_sentence(verdict, effects, at, BEFORE, after, proof, **told)


@pytest.mark.parametrize(
    ("sentence", "wanted"),
    [
        (said("adequate", large=False), "The model explains the recordings: what remains is noise"),
        (said("adequate"), "errors reach 20 times the noise in the cart position, but they do not repeat"),
        (said("adequate", asked=False), "they hang together no longer than noise does"),
        (
            said("adequate", once=Once("x", "psi", ("b.csv", "d.csv"), 1.2, (Interval("b.csv", 4.75, 7.5),))),
            "in the cart position, but all of it comes from b.csv (4.8 to 7.5 s), d.csv; the other recordings are met "
            "within 1.2 times the noise.",
        ),
        (
            said("missing_physics", [FRICTION]),
            "The model lacks physics: Coulomb friction at the cart. With it the error on the hold-out falls from 30 to "
            "1.2 times the noise in free runs.",
        ),
        (said("missing_physics", [FRICTION], BEFORE), "What is left does not repeat from one recording to another."),
        (
            said("missing_physics", [MASS]),
            "A known number is wrong: the load mass, which comes out as 0.2 ± 0.02 kg. With it the error on",
        ),
        (
            said("missing_physics", [FRICTION, MASS]),
            "Coulomb friction at the cart and the load mass, which comes out as 0.2 ± 0.02 kg. With them",
        ),
        (said("unknown", after=BEFORE), "nothing in the catalogue explains it: errors reach 20 times the noise."),
        (said("unknown", [FRICTION], BEFORE), "What was found explains a part of it only."),
        (said("unknown", after=BEFORE, at=AS_FRICTION), "20 times the noise. The missing force takes energy out."),
        (
            said("unknown", [FRICTION], unproven=True, at=AS_FRICTION),
            "in windows of 2 s. The missing force takes energy out.",
        ),
        (
            said("unknown", curve=True),
            "errors reach 20 times the noise. The model file keeps the missing force as a curve. With it the error on "
            "the hold-out falls from 30 to 1.2 times the noise in free runs.",
        ),
        (
            said("unknown", [FRICTION], curve=True),
            "What was found explains a part of it only. The model file keeps the missing force as a curve. With both "
            "the error on the hold-out falls",
        ),
        (
            said("unknown", [FRICTION], unproven=True),
            "leaves errors of 15 times the noise on the hold-out, in windows of 2 s.",
        ),
        (
            said("missing_physics", [FRICTION], abroad=OffMap("l", (0.45, 0.86), (0.85, 1.15))),
            "With it what is left of the recordings is noise. On the hold-out errors go from 30 to 1.2 times the noise "
            "in free runs, but it is no judge of a map of friction: its rope length goes from 0.85 to 1.15 m, the "
            "recordings' from 0.45 to 0.86 m,",
        ),
    ],
)
def test_verdicts_read_as_sentences(sentence, wanted):
    assert wanted in sentence and sentence.endswith(".")


FAST = Elsewhere("x", "fast.csv", 3.04)


def test_what_the_hold_out_alone_shows_is_told_with_its_recording():
    alone = said("unknown", large=False, elsewhere=FAST)
    assert alone.startswith(
        "The model explains these recordings, but not the hold-out: errors of fast.csv reach 3 times"
    )
    beside = said("missing_physics", [FRICTION], elsewhere=FAST)
    assert beside.startswith("The model lacks physics: Coulomb friction at the cart. With it the error on the hold-out")
    assert "But fast.csv is still met worse than uncertain numbers allow, with 3 times the noise" in beside
    # No recording is said to be explained that is not.
    learned = said("unknown", odd_one=FAST)
    assert learned.startswith("What fast.csv shows in the cart position does not repeat in the other recordings")
    assert "explains" not in learned


def test_a_simulation_that_ran_away_has_words():
    assert "more than a million times the noise" in said("unknown", elsewhere=FAST._replace(ratio=float("inf")))


def test_rivals_are_named_as_an_owner_would():
    rivals = [Rival("wrong_value", "cart_mass", 0.2, {}, {}), Rival("stribeck_friction", "cart_drive", 0.1, {}, {})]
    sentence = effect_sentence("coulomb_friction", "cart", {}, rivals)
    assert "cannot tell it from a wrong value of the cart mass or Stribeck friction at the cart drive." in sentence
