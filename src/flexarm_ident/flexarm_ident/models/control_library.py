"""python-control, imported without the plots and the statistics that it seldom uses.

python-control imports pyplot at its top, and scipy.signal all of scipy.stats for one function. Both
together take as long as a whole identification of a short record. While they are imported, these
modules are therefore stand-ins, which the importing ones alone keep: each imports the real one when
something of it is used, so that `control.bode_plot` and the others draw as ever.
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
    "scipy.stats": ("scoreatpercentile",),
}
"""Modules that the import of python-control can do without, and their functions it takes then."""


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
        _make_room(self)
        return getattr(import_module(self.__name__), name)


@contextmanager
def _stand_ins() -> Iterator[None]:
    """Have stand-ins among the imported modules for those that are missing, for that while."""
    stand_ins = {name: _StandIn(name) for name in _LATER if name not in sys.modules}
    for name, stand_in in stand_ins.items():
        for function in _LATER[name]:
            setattr(stand_in, function, _deferred(name, function))
        package, _, short = name.rpartition(".")
        if package in stand_ins:
            setattr(stand_ins[package], short, stand_in)
    sys.modules.update(stand_ins)
    try:
        yield
    finally:
        for stand_in in stand_ins.values():
            _make_room(stand_in)


def _make_room(stand_in: _StandIn) -> None:
    """Take a stand-in out of the imported modules, if the real one has not come there already."""
    if sys.modules.get(stand_in.__name__) is stand_in:
        del sys.modules[stand_in.__name__]


def _deferred(module: str, function: str) -> Callable[..., Any]:
    """Return a function that imports its module when it is called."""

    def call(*args: Any, **settings: Any) -> Any:  # noqa: ANN401 - as the function has it
        return getattr(import_module(module), function)(*args, **settings)

    return call
