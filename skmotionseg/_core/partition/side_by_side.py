"""Searches that run side by side, so that what they ask for is computed together.

A search that needs a few fits before it knows what to do next leaves most of the time
to the calls of small arrays. Written as a generator, it yields a list of requests and
is sent a list of their answers; several such searches that run side by side share one
batch per round, and are a search themselves.
"""

from __future__ import annotations


def side_by_side(searches):
    """A search that runs others in rounds, joining their requests.

    Parameters
    ----------
    searches : iterable of generator
        Each yields lists of requests and is sent lists of as many answers.

    Yields
    ------
    list
        The requests of all searches that have not come to their end.

    Returns
    -------
    list
        What each search returns.
    """
    searches = list(searches)
    found = [None] * len(searches)
    answers = dict.fromkeys(range(len(searches)))
    while True:
        asked = {}
        for k, answer in answers.items():
            try:
                asked[k] = searches[k].send(answer)
            except StopIteration as end:
                found[k] = end.value
        if not asked:
            return found
        given = iter((yield [one for some in asked.values() for one in some]))
        answers = {k: [next(given) for _ in some] for k, some in asked.items()}


def run(search, answer):
    """What a search returns, its requests being answered.

    Parameters
    ----------
    search : generator
    answer : callable
        Takes a list of requests to a list of as many answers.
    """
    answers = None
    while True:
        try:
            requests = search.send(answers)
        except StopIteration as end:
            return end.value
        answers = answer(requests)
