"""The code of one's own functions and classes, of which pickles hold the names alone.

What was computed by them is kept under a name, too, and would be found again when they
have been edited.
"""

from __future__ import annotations

import hashlib
import io
import pickle
from types import CodeType, FunctionType

import joblib

from .callers import LIBRARIES

# Whose code changes with their versions, and what has none.
OTHERS = (*LIBRARIES, "numpy", "scipy", "builtins")
# What a module's constants may be.
CONSTANTS = (bool, int, float, complex, str, bytes, tuple, frozenset)


def code_of(*values):
    """A digest of the code of all functions and classes that are pickled by name.

    Parameters
    ----------
    *values : object
        That can be pickled.

    Returns
    -------
    str
        Of the functions and classes of other packages than this and those that it is
        built on, and of what they use of their own modules, constants too; the same in
        every process. Empty if there are none, or values cannot be pickled.
    """
    pickler = _ByName(io.BytesIO())
    try:
        pickler.dump(values)
    except Exception:  # whatever pickles raise; who keeps the values says so
        return ""
    seen: set[int] = set()  # identities, of what modules and classes keep
    parts = [part for value in pickler.found for part in _parts_of(value, seen)]
    return hashlib.blake2b(repr(parts).encode()).hexdigest() if parts else ""


class _ByName(pickle.Pickler):
    """Notes the functions and classes that are pickled by name."""

    def __init__(self, file):
        super().__init__(file)
        self.found = []

    def reducer_override(self, value):
        wrapped = getattr(value, "__wrapped__", None)  # as of functools.cache
        if isinstance(value, FunctionType | type) or isinstance(wrapped, FunctionType):
            self.found.append(value)
        return NotImplemented


def _parts_of(value, seen):
    """Yield what the code of a function or class says, and of what it uses, once."""
    package = getattr(value, "__module__", None) or ""
    if id(value) in seen or package.partition(".")[0] in OTHERS:
        return
    seen.add(id(value))
    value = getattr(value, "__wrapped__", value)
    if isinstance(value, type):
        for name, member in sorted(vars(value).items()):
            for function in _functions_of(member):
                yield name
                yield from _parts_of(function, seen)
        for base in value.__bases__:
            yield from _parts_of(base, seen)
    elif isinstance(value, FunctionType):
        yield value.__qualname__, _said(value.__code__)
        yield joblib.hash((value.__defaults__, value.__kwdefaults__))
        for name in sorted(_names_in(value.__code__) & value.__globals__.keys()):
            used = value.__globals__[name]
            if isinstance(used, CONSTANTS):
                yield name, joblib.hash(used)
            elif getattr(used, "__module__", None) == value.__module__:
                yield from _parts_of(used, seen)


def _functions_of(member):
    """The functions of a member of a class."""
    if isinstance(member, property):
        return [each for each in (member.fget, member.fset) if each is not None]
    member = getattr(member, "__func__", member)  # of class and static methods
    return [member] if isinstance(member, FunctionType) else []


def _said(code):
    """What some code does, wherever it stands."""
    constants = [
        _said(each) if isinstance(each, CodeType) else joblib.hash(each)
        for each in code.co_consts
    ]
    return code.co_code, code.co_names, code.co_varnames, constants


def _names_in(code):
    inner = (each for each in code.co_consts if isinstance(each, CodeType))
    return set(code.co_names).union(*map(_names_in, inner))
