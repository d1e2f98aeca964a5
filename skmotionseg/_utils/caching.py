"""Results that are kept, and found again."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator
from sklearn.utils.validation import check_memory

from .._version import __version__
from .own_code import code_of
from .warning import warn_user


def as_memory(memory):
    """A joblib.Memory, of one, a path or None, which remembers nothing."""
    is_path = isinstance(memory, os.PathLike)
    return check_memory(os.fspath(memory) if is_path else memory)


def check_cacheable(memory: object, random_state: object, name: str) -> None:
    """Warn where nothing that is kept could be found again.

    Parameters
    ----------
    memory : object
        As given to an estimator; None is no memory.
    random_state : object
        Of the same estimator.
    name : str
        Of the parameter, for the message.
    """
    if memory is not None and not isinstance(random_state, int | np.integer):
        warn_user(
            f"memory has no effect without an integer {name}, because other seeds "
            f"give other results; got {name}={random_state!r}",
        )


def recall(memory, function, *arguments):
    """What a function gives, from memory, or else put there.

    Parameters
    ----------
    memory : joblib.Memory
    function : callable
        ``(*arguments, version) -> result``; the version says of what code it is.
    *arguments
    """
    # Where joblib maps arrays into memory for its workers, they are hashed as others.
    plain = [np.asarray(a) if isinstance(a, np.ndarray) else a for a in arguments]
    others = [a for a in arguments if not isinstance(a, np.ndarray)]
    keeps = getattr(memory, "location", memory) is not None
    version = _version_of(*others) if keeps else ""
    return memory.cache(function)(*plain, version)


def _version_of(*values):
    """Of this package and of one's own code in some values."""
    return f"{__version__} {code_of(*values)}"


class StateOfCode(BaseEstimator):
    """An estimator whose pickle says by what code it is.

    So that what scikit-learn's pipelines keep is found again with that code alone.
    """

    def __getstate__(self):
        parameters = self.get_params(deep=False).values()
        state: Any = super().__getstate__()
        return {**state, "_code": _version_of(*parameters)}

    def __setstate__(self, state):
        super().__setstate__({k: v for k, v in state.items() if k != "_code"})
