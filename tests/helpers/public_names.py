"""What is public, by name, read off the package."""

from __future__ import annotations

import importlib
import inspect
import pkgutil

import skmotionseg

MODULES = {
    info.name: importlib.import_module(f"skmotionseg.{info.name}")
    for info in pkgutil.iter_modules(skmotionseg.__path__)
    if not info.name.startswith("_")
}


def own_methods(cls):
    """Public methods that the package writes, its mixins' included."""
    return {
        f"{cls.__name__}.{name}": method
        for name, method in inspect.getmembers(cls, inspect.isfunction)
        if not name.startswith("_") and method.__module__.startswith("skmotionseg")
    }


NAMES = {
    f"{module.__name__}.{name}": getattr(module, name)
    for module in (skmotionseg, *MODULES.values())
    for name in sorted(module.__all__)
    # What the package has at its top is listed there.
    if module is skmotionseg or name not in skmotionseg.__all__
}


CLASSES = [value for value in NAMES.values() if inspect.isclass(value)]


FUNCTIONS = [name for name, value in NAMES.items() if value not in CLASSES]


ESTIMATORS = [cls for cls in CLASSES if hasattr(cls, "fit")]


METHODS = {name: m for cls in CLASSES for name, m in own_methods(cls).items()}
