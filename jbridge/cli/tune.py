"""`jbridge tune`: a controller made better by gradients."""

import argparse
import dataclasses
import math

import jbridge
from jbridge import InputError

from .common import MODEL, OUT, Commands, Console, command, controller_of, model_path, written

_HELP = """\
Tunes a fuzzy controller's sets, scales and rule weights, or another law's
gains, by gradients through simulated moves of many bridges with parameters
about those of a model, and compares the result on further bridges and moves.

Without --controller the rules named by --rules are tuned: the extended ones, in
which velocity and swing angle act, or the paper's; or a PID controller, or
state feedback that begins as an LQR of the model, on the positions' differences
(lqr) or on the states that a Kalman filter estimates (lqg). DIR receives
controller.toml (tuned, for jbridge control), controller.h (the same in C),
tune.html (to look at), tune.json (the same in numbers) and the figures.

Parameters scatter by the uncertainties that a fit or a diagnosis has written
into the model, otherwise by shares that are usual for laboratory bridges.
"""


def add(commands: Commands) -> None:
    """Adds the command to the parser."""
    tune = command(commands, "tune", "tune a controller by gradients", _HELP, run)
    tune.epilog = "example:\n  jbridge tune fitted/model.toml --out tuned"
    tune.add_argument("model", metavar="MODEL.toml", type=model_path, help=MODEL)
    tune.add_argument("--controller", metavar="CONTROLLER.toml", help="the controller to start from")
    rules = ("extended", "paper", "pid", "lqr", "lqg")
    tune.add_argument("--rules", choices=rules, default=rules[0], help="control law without --controller (%(default)s)")
    tune.add_argument("--plants", type=int, default=64, metavar="N", help="bridges to learn from (%(default)s)")
    tune.add_argument("--steps", type=int, default=200, metavar="N", help="gradient steps (%(default)s)")
    tune.add_argument(
        "--starts", type=int, default=3, metavar="N", help="starting points; only the best is continued (%(default)s)"
    )
    tune.add_argument("--seed", type=int, default=0, metavar="N", help="of bridges, moves and starts (%(default)s)")
    tune.add_argument("--rail", type=float, nargs=2, metavar=("LOW", "HIGH"), help="where carts move to [m] (0 1.2)")
    tune.add_argument("--rope", type=float, nargs=2, metavar=("LOW", "HIGH"), help="rope lengths [m] (0.185 0.7)")
    tune.add_argument(
        "--limits",
        type=float,
        nargs=2,
        metavar=("CART", "HOIST"),
        help="largest commands, in the inputs' unit (3 10 V)",
    )
    tune.add_argument("--shaping", choices=("zv", "zvd"), help="shape the reference for a rope in the middle of --rope")
    tune.add_argument(
        "--delay", type=float, default=0.0, metavar="MS", help="largest additional delay of the drives [ms] (0)"
    )
    tune.add_argument("--out", metavar="DIR", required=True, help=OUT)


def run(arguments: argparse.Namespace, console: Console) -> None:
    given = [path for path in (arguments.model, arguments.controller) if path]
    jbridge.check_output(arguments.out, folder=True, inputs=given)
    if not 0.0 <= arguments.delay < 1e3:
        raise InputError(f"--delay {arguments.delay:g}: give milliseconds, 0 or more and less than 1000")
    console("reading")
    jbridge.set_up(arguments.cache)
    model = jbridge.load_model(arguments.model)
    if arguments.controller or arguments.rules == "paper":
        if arguments.limits:
            raise InputError("--limits: a controller's file and the paper's rules have their own; give other --rules")
        controller = controller_of(arguments.controller)
    else:
        controller = _law(arguments.rules, model, arguments.limits)
    jbridge.check_output(arguments.out, folder=True, inputs=[*given, *controller.files])
    region = _region(arguments.rail, arguments.rope)
    if arguments.shaping:
        controller = _shaped(controller, arguments.shaping, model, region or jbridge.PAPER_REGION)
    tuning = jbridge.tune(
        model,
        controller,
        plants=arguments.plants,
        steps=arguments.steps,
        starts=arguments.starts,
        seed=arguments.seed,
        region=region,
        scatter=jbridge.Scatter(late=1e-3 * arguments.delay),
        progress=console,
    )
    console("drawing")
    jbridge.save_tuning(arguments.out, tuning)
    console.show(jbridge.describe_tuning(tuning, arguments.out), lambda: written(arguments.out, "tune.json"))


def _law(rules: str, model: "jbridge.Model", limits: list[float] | None) -> "jbridge.Controller":
    """A controller to begin with, made for a model and the largest commands of its drives."""
    cart, hoist = limits or jbridge.drive_limits(model)
    if not (0.0 < cart < math.inf and 0.0 < hoist < math.inf):
        raise InputError(f"--limits {cart:g} {hoist:g}: give the largest command of the cart and of the hoist, above 0")
    given = jbridge.compensation_for(model.plant, limits=(cart, hoist))
    if rules == "extended":
        return jbridge.Controller(jbridge.extended_controller(given))
    if rules == "pid":
        return jbridge.Controller(jbridge.pid_for(given))
    return (jbridge.lqg_controller if rules == "lqg" else jbridge.lqr_controller)(model, given)


def _shaped(
    controller: "jbridge.Controller", kind: str, model: "jbridge.Model", region: "jbridge.Region"
) -> "jbridge.Controller":
    """The same controller with its reference shaped for the free swing on the mean rope length of a region."""
    frequency = math.sqrt(float(model.plant.bridge.gravity) / (0.5 * sum(region.rope)))
    return dataclasses.replace(controller, shaping=jbridge.Shaping(kind, frequency))


def _region(rail: list[float] | None, rope: list[float] | None) -> "jbridge.Region | None":
    """Where moves begin and end, if that is told."""
    if rail is None and rope is None:
        return None
    ends = {}
    for name, given, usual, least in (
        ("rail", rail, jbridge.PAPER_REGION.rail, -float("inf")),
        ("rope", rope, jbridge.PAPER_REGION.rope, 0.0),
    ):
        low, high = given or usual
        if not (least < low < high < float("inf") or name == "rope" and 0.0 < low == high):
            raise InputError(f"--{name} {low:g} {high:g}: give the lower end and the higher one in metres")
        ends[name] = (low, high)
    return jbridge.Region(**ends)
