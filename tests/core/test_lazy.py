"""A lazy value is computed once per instance, and kept."""

from __future__ import annotations

from skmotionseg._core.graph.lazy import lazy


class Counted:
    """Counts how often its value is computed."""

    n_computed = 0

    @lazy
    def value(self):
        """What is asked for."""
        self.n_computed += 1
        return object()


def test_a_value_is_computed_when_it_is_first_asked_for_and_kept():
    counted, other = Counted(), Counted()
    assert counted.n_computed == 0
    assert counted.value is counted.value
    assert counted.n_computed == 1
    assert other.value is not counted.value


def test_the_class_shows_what_the_value_is():
    assert isinstance(Counted.value, lazy)
    assert Counted.value.__doc__ == "What is asked for."
