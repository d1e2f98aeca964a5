"""A value that is computed when it is first asked for."""

from __future__ import annotations


class lazy:
    """Decorate a method: its value is computed once an instance, and kept.

    Unlike :class:`functools.cached_property` before Python 3.12, there is no lock. That
    lock is shared by all instances, so threads would wait for one another; and a
    process that is forked while another thread holds it would wait for ever. Threads
    that ask one instance at the same time may compute the value twice.

    Parameters
    ----------
    compute : callable
        Takes the instance.
    """

    def __init__(self, compute):
        self.compute = compute
        self.__doc__ = compute.__doc__

    def __set_name__(self, owner, name):
        self.name = name

    def __get__(self, instance, owner=None):
        if instance is None:
            return self
        value = instance.__dict__[self.name] = self.compute(instance)
        return value
