"""A small runner of what asv would run: classes with ``params`` and ``time_*``."""

from __future__ import annotations

import importlib
import pkgutil
import re
from itertools import product
from typing import NamedTuple

import benchmarks

from . import report
from .measuring import (
    in_fresh_process,
    interleave,
    peak_memory,
    show_progress,
    spread,
)

COLUMNS = {
    "benchmark": lambda row: row["row"],
    "seconds": report.seconds,
    "peak MB": report.megabytes,
}


class Benchmark(NamedTuple):
    """A method of a benchmark class, at one point of its parameters."""

    kind: type
    method: str
    values: tuple

    def __str__(self):
        named = zip(self.kind.param_names, self.values, strict=True)
        module = self.kind.__module__.rpartition(".")[2]
        arguments = ", ".join(f"{name}={value}" for name, value in named)
        return f"{module}.{self.kind.__name__}.{self.method}({arguments})"

    def make_ready(self):
        """The method of an object that is set up."""
        scene = self.kind()
        scene.setup(*self.values)
        return getattr(scene, self.method)


def discover(quick=False):
    """Yield what asv would find; ``quick`` takes each parameter's first value alone."""
    for module in pkgutil.iter_modules(benchmarks.__path__):
        if module.name == "__main__":
            continue
        members = vars(importlib.import_module(f"benchmarks.{module.name}"))
        for kind in members.values():
            public = isinstance(kind, type) and not kind.__name__.startswith("_")
            if public and kind.__module__ == members["__name__"]:
                yield from _of_class(kind, quick)


def _of_class(kind, quick):
    methods = [m for m in dir(kind) if re.match("time_|peakmem_", m)]
    axes = [axis[:1] if quick else axis for axis in getattr(kind, "params", ())]
    for values in product(*axes):
        for method in methods:
            yield Benchmark(kind, method, values)


def run(benchmark, repeats):
    """A row: seconds of the repeats, or the peak memory of a process of its own."""
    if benchmark.method.startswith("peakmem_"):
        return {"row": str(benchmark), "peak": in_fresh_process(_peak, benchmark)}
    call = benchmark.make_ready()
    runs = interleave({"it": lambda _: call(*benchmark.values)}, repeats)["it"]
    return {"row": str(benchmark), "seconds": spread(runs.seconds)}


def _peak(benchmark):
    benchmark.make_ready()(*benchmark.values)
    return peak_memory()


def run_all(pattern, repeats, quick):
    """Yield a row a benchmark in whose name the regular expression is found."""
    chosen = [b for b in discover(quick) if re.search(pattern, str(b))]
    for i, benchmark in enumerate(chosen):
        show_progress(f"[{i + 1} of {len(chosen)}] {benchmark}")
        yield run(benchmark, repeats)
    show_progress("")
