"""What is public, by name, read off the package."""

from __future__ import annotations

import inspect

import skmotionseg
from skmotionseg import cli, datasets, metrics, plotting, preprocessing, video


def functions_of(module):
    """Public functions that are written in the module."""
    return {
        name
        for name, value in inspect.getmembers(module, inspect.isfunction)
        if not name.startswith("_") and value.__module__ == module.__name__
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
    for module, names in (
        (skmotionseg, skmotionseg.__all__),
        (datasets, datasets.__all__),
        (metrics, functions_of(metrics)),
        (plotting, plotting.__all__),
        (preprocessing, functions_of(preprocessing)),
        (video, video.__all__),
        (cli, {"main"}),
    )
    for name in sorted(names)
}


CLASSES = [value for value in NAMES.values() if inspect.isclass(value)]


FUNCTIONS = [name for name, value in NAMES.items() if value not in CLASSES]


ESTIMATORS = [cls for cls in CLASSES if hasattr(cls, "fit")]


METHODS = {name: m for cls in CLASSES for name, m in own_methods(cls).items()}
