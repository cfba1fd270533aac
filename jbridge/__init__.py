"""jbridge: a differentiable simulator of a laboratory loading bridge, and why a rig and its model differ.

Every public name stands in `__init__.pyi` and is loaded when it is first used, so that importing the package costs
nothing. None is called like a module of this package, which would hide it once loaded.
"""

import importlib

import lazy_loader

from jbridge._display import connect

connect(lambda: importlib.import_module(f"{__name__}.report.displays"))
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
