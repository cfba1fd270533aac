"""The verdict as a rig's owner reads it."""

import math

import pytest

from jbridge.diagnosis.result import NamedEffect, Rival
from jbridge.diagnosis.words import Remains, apart_sentence, effect_sentence, verdict_sentence
from jbridge.identification.result import Estimate

FRICTION = NamedEffect(
    kind="coulomb_friction", site="cart", probability=1.0, parameters={}, equivalents=(), statement=""
)
MASS = NamedEffect(
    kind="wrong_value",
    site="load_mass",
    probability=1.0,
    parameters={"value": Estimate(0.2, 0.01, 0.18, 0.22, "kg")},
    equivalents=(),
    statement="",
)
DOUBTED = NamedEffect(
    kind="coulomb_friction",
    site="cart",
    probability=1.0,
    parameters={},
    equivalents=(),
    statement="",
    status="suggested",
)


def said(verdict, effects=(), explained=0.962, ratio=13.0, horizon=1.0, learned=None, scatter=False, **told):
    remains = Remains(ratio, "x", horizon, scatter, "0.4 mm")
    shares = explained if isinstance(explained, dict) else {"x": explained}
    told = {"complete": False, "stopped": "criterion", "tried": True, **told}
    return verdict_sentence(verdict, effects, (shares, learned or {}), remains, **told)


@pytest.mark.parametrize(
    ("sentence", "wanted"),
    [
        (
            said("adequate", ratio=1.2),
            "what remains is noise or the rig's own measured scatter, at most 1.2 times it (cart position, in windows",
        ),
        (
            said("missing_physics", [FRICTION]),
            "The model lacks physics: Coulomb friction at the cart explains 96.2 % of the hold-out's error at 1 s. "
            "What remains, 0.4 mm in the cart position in windows of 1 s, is 13 times what noise explains, and is "
            "unexplained.",
        ),
        (said("missing_physics", [FRICTION], complete=True), "What remains is noise."),
        (said("missing_physics", [FRICTION], complete=True, scatter=True), "remains is scatter between repeated runs."),
        (said("missing_physics", [FRICTION], scatter=True), "is 13 times the scatter of repeated runs, and is"),
        (said("missing_physics", [FRICTION], 0.99996), "explains 99.9 % of"),
        (
            said("missing_physics", [FRICTION], {"x": 0.98, "psi": -0.1, "l": 0.3}),
            "explains 98 % (cart position), nothing (swing angle) and 30 % (rope length) of the hold-out's error",
        ),
        (
            said("missing_physics", [FRICTION], {}, complete=True),
            "Coulomb friction at the cart is confirmed by the hold-out, but small: without it the error at 1 s is "
            "hardly more than noise. What remains is noise.",
        ),
        (
            said("unknown", [FRICTION], -0.98),
            "What was found, Coulomb friction at the cart, is confirmed, since most windows of the hold-out are met "
            "worse without it, but explains nothing of the hold-out's error at 1 s: the windows with the largest "
            "errors, which make up most of the sum of squares, are met no better; what remains, 0.4 mm in the",
        ),
        (said("unknown", [FRICTION, MASS], -0.98), "are confirmed, since most windows of the hold-out are met worse"),
        (said("missing_physics", [FRICTION, MASS]), "explain 96.2 %"),
        (said("missing_physics", [MASS]), "A known number is wrong: the load mass, which comes out as 0.2 ± 0.02 kg"),
        (said("missing_physics", [FRICTION, MASS]), "Coulomb friction at the cart and the load mass, which comes out"),
        (said("unknown", [FRICTION], 0.3), "What was found, Coulomb friction at the cart, explains 30 % of"),
        (said("unknown", [DOUBTED]), "nothing in the catalogue explains the hold-out: what remains, 0.4 mm in the"),
        (
            said("unknown", [DOUBTED], learned={"x": 0.97}),
            "What was found, Coulomb friction at the cart, explains 97 % of the training recordings' error at 1 s, "
            "but the hold-out does not confirm it: what remains, 0.4 mm in the",
        ),
        (said("unknown", horizon=math.inf), "in whole recordings"),
        (said("unknown", stopped="budget"), "give it more with --budget."),
        (said("unknown", stopped="budget"), "nothing that was tried by then explains the hold-out"),
        (said("unknown", stopped="budget", tried=False), "Something is missing, and nothing was tried by then"),
        (
            said(None, [FRICTION], stopped="interrupted"),
            "after it had found Coulomb friction at the cart; the hold-out",
        ),
        (said("unknown", ratio=math.inf), "more than a million times what noise explains"),
    ],
)
def test_verdicts_read_as_sentences(sentence, wanted):
    assert wanted in sentence and sentence.endswith(".")


def test_a_recording_that_differs_is_told_with_what_to_do():
    def told(*ratios, held_out=False):
        numbers = [("cart_gain", "22 N/V", ratios[0]), ("cart_damping", "12 N s/m", 0.5)][: len(ratios)]
        return apart_sentence("run-4.csv", numbers, "x", 0.9, held_out=held_out)

    assert told(1.96, 0.5).startswith(
        "run-4.csv differs from the other recordings: a cart gain of 22 N/V (1.96 times that of the others) or a cart "
        "damping of 12 N s/m (0.5 times that of the others) would close 90 % of its excess squared error in the cart "
        "position."
    )
    # No model may be proved on a number that was learned from its proof.
    assert "measure it" in told(1.96, held_out=True) and "measure it" not in told(1.96)
    assert "times" not in told(math.inf)


def test_rivals_are_named_as_an_owner_would():
    rivals = [Rival("wrong_value", "cart_mass", 0.2, {}, {}), Rival("stribeck_friction", "cart_drive", 0.1, {}, {})]
    sentence = effect_sentence("coulomb_friction", "cart", {}, rivals)
    assert "cannot tell it from a wrong value of the cart mass or Stribeck friction at the cart drive." in sentence
