"""Optional dependencies, imported where they are used."""

from __future__ import annotations

from importlib import import_module


def require(module, *, extra):
    """Import an optional dependency.

    Parameters
    ----------
    module : str
    extra : str
        The extra of this package that brings it.

    Raises
    ------
    ImportError
        If it is missing, with the command that installs it. As the package itself is
        installed, that adds only what the extra needs, and no index has to know the
        package.
    """
    try:
        return import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise ImportError(
            f'this needs {package}, which is not installed: pip install "skmotionseg'
            f'[{extra}]"'
        ) from error
