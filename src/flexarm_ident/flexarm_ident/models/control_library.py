"""python-control, imported without what it seldom uses: plots, statistics, filters, optimisation.

python-control imports pyplot and much of scipy at its top, for a few functions, which takes longer
than a whole identification of a short record. While it is imported, these modules are therefore
stand-ins, which the importing ones alone keep: each imports the real one when something of it is
used, so that `control.bode_plot` and the others draw as ever.
"""

from __future__ import annotations

import sys
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

_LATER = {
    "matplotlib": (),
    "matplotlib.pyplot": (),
    "matplotlib.transforms": (),
    # It derives a class from matplotlib's, which no stand-in can be.
    "control.grid": ("nogrid", "sgrid", "zgrid"),
    # It derives classes from those of scipy.optimize.
    "control.optimal": (),
    "scipy.integrate": ("odeint",),
    "scipy.interpolate": ("splev", "splprep"),
    "scipy.signal": ("StateSpace", "TransferFunction", "cont2discrete", "tf2zpk", "zpk2tf"),
    "scipy.stats": ("scoreatpercentile",),
}
"""Modules that the import of python-control can do without, and their functions it takes then."""
_SETTINGS = {"control.optimal": "_optimal_defaults"}
"""Settings that it collects of them; where none is set, each has its own in any case."""


def control_library() -> ModuleType:
    """Return python-control, imported without what is not there yet of `_LATER`."""
    if "control" not in sys.modules:
        with _stand_ins():
            import_module("control")
    return import_module("control")


class _StandIn(ModuleType):
    """Module that is imported when something of it is used."""

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - whatever the module has
        """Return what the real module has by that name."""
        if name.startswith("__"):  # asked of every module by the import itself
            raise AttributeError(name)
        return getattr(_real(self.__name__), name)


@contextmanager
def _stand_ins() -> Iterator[None]:
    """Have stand-ins among the imported modules for those that are missing, for that while."""
    stand_ins = {name: _StandIn(name) for name in _LATER if name not in sys.modules}
    for name, stand_in in stand_ins.items():
        for function in _LATER[name]:
            setattr(stand_in, function, _deferred(name, function))
        if name in _SETTINGS:
            setattr(stand_in, _SETTINGS[name], {})
        package, _, short = name.rpartition(".")
        if package in stand_ins:
            setattr(stand_ins[package], short, stand_in)
    sys.modules.update(stand_ins)
    try:
        yield
    finally:
        for stand_in in stand_ins.values():
            _make_room(stand_in)


def _real(name: str) -> ModuleType:
    """Import a module in the place of its stand-in; the others go with it, for it may need them."""
    for module in list(sys.modules.values()):
        if isinstance(module, _StandIn):
            _make_room(module)
    return import_module(name)


def _make_room(stand_in: _StandIn) -> None:
    """Take a stand-in out of the imported modules, if the real one has not come there already."""
    if sys.modules.get(stand_in.__name__) is stand_in:
        del sys.modules[stand_in.__name__]


def _deferred(module: str, function: str) -> Callable[..., Any]:
    """Return a function that imports its module when it is called."""

    def call(*args: Any, **settings: Any) -> Any:  # noqa: ANN401 - as the function has it
        return getattr(_real(module), function)(*args, **settings)

    return call
