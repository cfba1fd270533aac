"""jbridge: a differentiable simulator of a laboratory loading bridge, and why a rig and its model differ.

Every public name is listed here and loaded when it is first used, so that importing the package costs nothing.
"""

import importlib
from typing import TYPE_CHECKING, Any

from jbridge._display import connect

if TYPE_CHECKING:
    from jbridge._types import Axes as Axes
    from jbridge.compilation.settings import set_up as set_up
    from jbridge.control.base import Reference as Reference
    from jbridge.control.compensation import Compensation as Compensation
    from jbridge.control.extended import extended_controller as extended_controller
    from jbridge.control.files import Controller as Controller
    from jbridge.control.files import load_controller as load_controller
    from jbridge.control.files import save_controller as save_controller
    from jbridge.control.fuzzy import FuzzyController as FuzzyController
    from jbridge.control.linear import Pid as Pid
    from jbridge.control.linear import StateFeedback as StateFeedback
    from jbridge.control.measures import moves as moves
    from jbridge.control.paper import paper_controller as paper_controller
    from jbridge.control.references import load_reference as load_reference
    from jbridge.control.references import paper_path as paper_path
    from jbridge.control.shaping import shaped as shaped
    from jbridge.diagnosis.diagnose import diagnose as diagnose
    from jbridge.diagnosis.result import Diagnosis as Diagnosis
    from jbridge.diagnosis.result import Former as Former
    from jbridge.errors import InputError as InputError
    from jbridge.export.c import controller_header as controller_header
    from jbridge.export.models import state_space as state_space
    from jbridge.export.save import save_export as save_export
    from jbridge.fuzzy.check import idle_parts as idle_parts
    from jbridge.fuzzy.fis import load_fis as load_fis
    from jbridge.fuzzy.fis import save_fis as save_fis
    from jbridge.identification.fit import Starts as Starts
    from jbridge.identification.fit import fit as fit
    from jbridge.identification.fit import fit_from_many as fit_from_many
    from jbridge.identification.identifiability import Identifiability as Identifiability
    from jbridge.identification.identifiability import identifiability as identifiability
    from jbridge.identification.result import Fit as Fit
    from jbridge.model.bridge import Bridge as Bridge
    from jbridge.model.effects.base import AbstractForce as AbstractForce
    from jbridge.model.effects.base import AbstractFriction as AbstractFriction
    from jbridge.model.effects.catalogue import CATALOGUE as CATALOGUE
    from jbridge.model.files import Model as Model
    from jbridge.model.files import load_model as load_model
    from jbridge.model.files import save_model as save_model
    from jbridge.model.parameters import with_values as with_values
    from jbridge.model.plant import Plant as Plant
    from jbridge.prediction import Simulation as Simulation
    from jbridge.prediction import simulate as simulate
    from jbridge.recordings import Inspection as Inspection
    from jbridge.recordings import Recording as Recording
    from jbridge.recordings import inspect_recordings as inspect_recordings
    from jbridge.recordings import load_recording as load_recording
    from jbridge.recordings import load_recordings as load_recordings
    from jbridge.recordings import save_csv as save_csv
    from jbridge.report.check import describe_check as describe_check
    from jbridge.report.check import save_check as save_check
    from jbridge.report.control.comparison import save_comparison as save_comparison
    from jbridge.report.control.paper import save_paper as save_paper
    from jbridge.report.control.rivals import describe_rivals as describe_rivals
    from jbridge.report.control.tracking import describe_tracking as describe_tracking
    from jbridge.report.control.tracking import save_tracking as save_tracking
    from jbridge.report.control.tuning import describe_tuning as describe_tuning
    from jbridge.report.control.tuning import save_tuning as save_tuning
    from jbridge.report.diagnosis.former import load_former as load_former
    from jbridge.report.diagnosis.many_rigs import Finding as Finding
    from jbridge.report.diagnosis.many_rigs import diagnose_each as diagnose_each
    from jbridge.report.files import check_output as check_output
    from jbridge.report.save import save_fit as save_fit
    from jbridge.report.save import save_report as save_report
    from jbridge.report.text.terminal import describe_diagnosis as describe_diagnosis
    from jbridge.report.text.terminal import describe_fit as describe_fit
    from jbridge.signals import Path as Path
    from jbridge.signals import smooth_path as smooth_path
    from jbridge.simulation.closed_loop import closed_loop as closed_loop
    from jbridge.simulation.collect import AbstractSummary as AbstractSummary
    from jbridge.simulation.collect import Every as Every
    from jbridge.simulation.collect import Everything as Everything
    from jbridge.simulation.rollout import play as play
    from jbridge.simulation.tracking import Tracking as Tracking
    from jbridge.simulation.tracking import track as track
    from jbridge.sweep.run import SweepResult as SweepResult
    from jbridge.sweep.run import read_sweep as read_sweep
    from jbridge.sweep.run import run_sweep as run_sweep
    from jbridge.sweep.spec import Sweep as Sweep
    from jbridge.sweep.spec import load_sweep as load_sweep
    from jbridge.tuning.compensation import compensation_for as compensation_for
    from jbridge.tuning.cost import Cost as Cost
    from jbridge.tuning.cost import Measure as Measure
    from jbridge.tuning.cost import measure as measure
    from jbridge.tuning.ensemble import PAPER_REGION as PAPER_REGION
    from jbridge.tuning.ensemble import Course as Course
    from jbridge.tuning.ensemble import Legs as Legs
    from jbridge.tuning.ensemble import Region as Region
    from jbridge.tuning.ensemble import Scatter as Scatter
    from jbridge.tuning.ensemble import mixed_legs as mixed_legs
    from jbridge.tuning.ensemble import paper_legs as paper_legs
    from jbridge.tuning.ensemble import random_legs as random_legs
    from jbridge.tuning.ensemble import scattered as scattered
    from jbridge.tuning.knobs import FuzzyKnobs as FuzzyKnobs
    from jbridge.tuning.knobs import knobs_of as knobs_of
    from jbridge.tuning.linearise import linear_model as linear_model
    from jbridge.tuning.linearise import lqr_controller as lqr_controller
    from jbridge.tuning.objectives import usual_goal as usual_goal
    from jbridge.tuning.tune import Tuning as Tuning
    from jbridge.tuning.tune import tune as tune

__version__: str

_HOMES = {
    "AbstractForce": "model.effects.base",
    "AbstractFriction": "model.effects.base",
    "AbstractSummary": "simulation.collect",
    "Axes": "_types",
    "Bridge": "model.bridge",
    "CATALOGUE": "model.effects.catalogue",
    "Compensation": "control.compensation",
    "Controller": "control.files",
    "Cost": "tuning.cost",
    "Course": "tuning.ensemble",
    "Diagnosis": "diagnosis.result",
    "Every": "simulation.collect",
    "Everything": "simulation.collect",
    "Finding": "report.diagnosis.many_rigs",
    "Fit": "identification.result",
    "Former": "diagnosis.result",
    "FuzzyController": "control.fuzzy",
    "FuzzyKnobs": "tuning.knobs",
    "Identifiability": "identification.identifiability",
    "InputError": "errors",
    "Inspection": "recordings",
    "Legs": "tuning.ensemble",
    "Measure": "tuning.cost",
    "Model": "model.files",
    "PAPER_REGION": "tuning.ensemble",
    "Path": "signals",
    "Pid": "control.linear",
    "Plant": "model.plant",
    "Recording": "recordings",
    "Reference": "control.base",
    "Region": "tuning.ensemble",
    "Scatter": "tuning.ensemble",
    "Simulation": "prediction",
    "Starts": "identification.fit",
    "StateFeedback": "control.linear",
    "Sweep": "sweep.spec",
    "SweepResult": "sweep.run",
    "Tracking": "simulation.tracking",
    "Tuning": "tuning.tune",
    "check_output": "report.files",
    "closed_loop": "simulation.closed_loop",
    "compensation_for": "tuning.compensation",
    "controller_header": "export.c",
    "describe_check": "report.check",
    "describe_diagnosis": "report.text.terminal",
    "describe_fit": "report.text.terminal",
    "describe_rivals": "report.control.rivals",
    "describe_tracking": "report.control.tracking",
    "describe_tuning": "report.control.tuning",
    "diagnose": "diagnosis.diagnose",
    "diagnose_each": "report.diagnosis.many_rigs",
    "extended_controller": "control.extended",
    "fit": "identification.fit",
    "fit_from_many": "identification.fit",
    "identifiability": "identification.identifiability",
    "idle_parts": "fuzzy.check",
    "inspect_recordings": "recordings",
    "knobs_of": "tuning.knobs",
    "linear_model": "tuning.linearise",
    "load_controller": "control.files",
    "load_fis": "fuzzy.fis",
    "load_former": "report.diagnosis.former",
    "load_model": "model.files",
    "load_recording": "recordings",
    "load_recordings": "recordings",
    "load_reference": "control.references",
    "load_sweep": "sweep.spec",
    "lqr_controller": "tuning.linearise",
    "measure": "tuning.cost",
    "mixed_legs": "tuning.ensemble",
    "moves": "control.measures",
    "paper_controller": "control.paper",
    "paper_legs": "tuning.ensemble",
    "paper_path": "control.references",
    "play": "simulation.rollout",
    "random_legs": "tuning.ensemble",
    "read_sweep": "sweep.run",
    "run_sweep": "sweep.run",
    "save_check": "report.check",
    "save_comparison": "report.control.comparison",
    "save_controller": "control.files",
    "save_csv": "recordings",
    "save_export": "export.save",
    "save_fis": "fuzzy.fis",
    "save_fit": "report.save",
    "save_model": "model.files",
    "save_paper": "report.control.paper",
    "save_report": "report.save",
    "save_tracking": "report.control.tracking",
    "save_tuning": "report.control.tuning",
    "scattered": "tuning.ensemble",
    "shaped": "control.shaping",
    "simulate": "prediction",
    "smooth_path": "signals",
    "state_space": "export.models",
    "track": "simulation.tracking",
    "tune": "tuning.tune",
    "usual_goal": "tuning.objectives",
    "with_values": "model.parameters",
    "set_up": "compilation.settings",
}
"""The module of each public name. None is called like a module of this package, which would hide it once loaded."""

__all__ = [
    "AbstractForce",
    "AbstractFriction",
    "AbstractSummary",
    "Axes",
    "Bridge",
    "CATALOGUE",
    "Compensation",
    "Controller",
    "Cost",
    "Course",
    "Diagnosis",
    "Every",
    "Everything",
    "Finding",
    "Fit",
    "Former",
    "FuzzyController",
    "FuzzyKnobs",
    "Identifiability",
    "InputError",
    "Inspection",
    "Legs",
    "Measure",
    "Model",
    "PAPER_REGION",
    "Path",
    "Pid",
    "Plant",
    "Recording",
    "Reference",
    "Region",
    "Scatter",
    "Simulation",
    "Starts",
    "StateFeedback",
    "Sweep",
    "SweepResult",
    "Tracking",
    "Tuning",
    "check_output",
    "closed_loop",
    "compensation_for",
    "controller_header",
    "describe_check",
    "describe_diagnosis",
    "describe_fit",
    "describe_rivals",
    "describe_tracking",
    "describe_tuning",
    "diagnose",
    "diagnose_each",
    "extended_controller",
    "fit",
    "fit_from_many",
    "identifiability",
    "idle_parts",
    "inspect_recordings",
    "knobs_of",
    "linear_model",
    "load_controller",
    "load_fis",
    "load_former",
    "load_model",
    "load_recording",
    "load_recordings",
    "load_reference",
    "load_sweep",
    "lqr_controller",
    "measure",
    "mixed_legs",
    "moves",
    "paper_controller",
    "paper_legs",
    "paper_path",
    "play",
    "random_legs",
    "read_sweep",
    "run_sweep",
    "save_check",
    "save_comparison",
    "save_controller",
    "save_csv",
    "save_export",
    "save_fis",
    "save_fit",
    "save_model",
    "save_paper",
    "save_report",
    "save_tracking",
    "save_tuning",
    "scattered",
    "set_up",
    "shaped",
    "simulate",
    "smooth_path",
    "state_space",
    "track",
    "tune",
    "usual_goal",
    "with_values",
]


connect(lambda: importlib.import_module(f"{__name__}.report.displays"))


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("jbridge")
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, "__version__"})
