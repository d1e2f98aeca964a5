"""Run the tests with the lowest and the newest dependencies, each in a fresh venv.

    python tests/environments.py [lowest] [newest] [bare] [-- PYTEST OPTIONS]

``lowest``: what pyproject.toml says is enough, of the package and, matplotlib apart, of
the extras ``cli`` and ``video``. The extra ``dask`` needs a newer joblib than the
package: its tests are skipped. ``newest``: what pip resolves, with all extras that have
tests. Warnings are errors in both, so what the next versions will refuse is found now.
``bare``: no extra and no test tool; a scene is segmented away from the sources. All
three by default.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import tomllib
import venv
from pathlib import Path

ROOT = Path(__file__).parents[1]
# Of matplotlib the newest will do: with warnings as errors, the library by which older
# ones read formulas warns of how they do it.
AS_IT_COMES = ("matplotlib",)
BARE = """
import sys
from skmotionseg import MotionSegmenter, save_motions
from skmotionseg.cli import main
from skmotionseg.datasets import load_tracks, make_rigid_motions
X, y = make_rigid_motions(100, 8, 2, random_state=0)
segmenter = MotionSegmenter(random_state=0).fit(X)
assert segmenter.n_motions_ == 2
files = save_motions("motions", X, segmenter.labels_)
predicted = segmenter.predict(load_tracks(files[1]).data)
assert (predicted == 1).mean() > 0.9
assert main(["demo"]) == 2
extras = {"matplotlib", "cv2", "rich", "dask", "pandas", "PIL"} & set(sys.modules)
assert not extras, extras
"""


def main(argv=None):
    parser = argparse.ArgumentParser(
        prog="python tests/environments.py",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="which of them")
    argv = sys.argv[1:] if argv is None else argv
    end = argv.index("--") if "--" in argv else len(argv)
    arguments, options = parser.parse_args(argv[:end]), argv[end + 1 :]
    names = arguments.names or list(ENVIRONMENTS)
    unknown = set(names) - set(ENVIRONMENTS)
    if unknown:
        parser.error(f"expected some of {', '.join(ENVIRONMENTS)}; got {unknown}")
    failed = [name for name in names if not succeeds(name, options)]
    print("\n".join(f"{n}: {'failed' if n in failed else 'good'}" for n in names))
    return 1 if failed else 0


def succeeds(name, options):
    """Make an environment, test in it, and remove it."""
    with tempfile.TemporaryDirectory() as folder:
        print(f"-- {name}", flush=True)
        venv.create(folder, with_pip=True)
        binaries = Path(folder) / ("Scripts" if os.name == "nt" else "bin")
        try:
            ENVIRONMENTS[name](binaries / "python", Path(folder), options)
        except subprocess.CalledProcessError as error:
            print(f"-- {name}: {error}", flush=True)
            return False
    return True


def lowest(python, folder, options):
    constraints = folder / "lowest.txt"
    constraints.write_text("\n".join(lowest_versions()))
    tools = [r for r in project()["optional-dependencies"]["test"] if "skmo" not in r]
    install(python, "-c", constraints, "-e", ".[cli,video]", *tools)
    test(python, "--ignore=skmotionseg/_parallel/dask.py", *options)


def newest(python, folder, options):
    install(python, "--upgrade", "--upgrade-strategy=eager", "-e", ".[test]")
    test(python, *options)


def bare(python, folder, options):
    install(python, ".")
    run([python, "-W", "error", "-c", BARE], cwd=folder)


ENVIRONMENTS = {"lowest": lowest, "newest": newest, "bare": bare}


def project():
    return tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def lowest_versions():
    """Constraints of pip: the first minor version of each range.

    >>> lowest_of("scipy>=1.11"), lowest_of("rich>=13")
    ('scipy==1.11.*', 'rich==13.0.*')
    """
    extras = project()["optional-dependencies"]
    every = [*project()["dependencies"], *extras["cli"]]
    every = [r for r in [*every, *extras["video"]] if ">=" in r]
    return [lowest_of(r) for r in every if not r.startswith(AS_IT_COMES)]


def lowest_of(requirement):
    name, version = re.fullmatch(r"([\w-]+)>=([\d.]+)", requirement).groups()
    return f"{name}=={version}{'' if '.' in version else '.0'}.*"


def install(python, *what):
    run([python, "-m", "pip", "install", "-q", *what])
    run([python, "-m", "pip", "check"])
    run([python, "-m", "pip", "list", "--format=freeze"])


def test(python, *options):
    run([python, "-m", "pytest", "-q", "-p", "no:cacheprovider", *options])


def run(command, cwd=ROOT):
    environment = {**os.environ, "PIP_DISABLE_PIP_VERSION_CHECK": "1"}
    subprocess.run([str(c) for c in command], cwd=cwd, env=environment, check=True)


if __name__ == "__main__":
    sys.exit(main())
