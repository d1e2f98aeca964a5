"""Habits of the code: short functions, typed signatures, numpydoc docstrings."""

from __future__ import annotations

import ast
import inspect
import io
import tokenize
from pathlib import Path

import pytest
from helpers.public_names import CLASSES, METHODS, NAMES
from helpers.slow_files import SLOW

import skmotionseg

PACKAGE = Path(skmotionseg.__file__).parent
ROOT = PACKAGE.parent
TESTS = ROOT / "tests"
FILES = sorted(
    path
    for folder in (PACKAGE, ROOT / "benchmarks", ROOT / "examples", TESTS)
    for path in folder.rglob("*.py")
)
MOST_LINES = 40
NO_CODE = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}
# Not asked for: EX01 (methods share the example of their class), SA01 (nor do all see
# others), ES01 (a line may say it all), PR09 and RT05 (a description may be a phrase),
# GL01 (the summary is on the first line), RT03 (a type may say it all), GL08 and RT02
# and PR07 likewise, and SS06 (the summary is one line, which is tested elsewhere).
CHECKS = {
    "GL02",  # closing quotes on their own line
    "GL03",  # double blank lines
    "GL05",  # tabs
    "GL06",  # unknown section
    "GL07",  # sections in another order
    "SS01",  # no summary
    "SS02",  # a summary that does not start with a capital letter
    "SS03",  # a summary that does not end with a period
    "SS04",  # a summary with leading spaces
    "PR01",  # undocumented parameters
    "PR02",  # unknown parameters
    "PR03",  # parameters in another order
    "PR05",  # a type that ends with a period
    "PR10",  # no space before the colon of a type
    "RT04",  # a return value that does not start with a capital letter
    "YD01",  # no Yields section
}


def lines_of_code(function, code):
    """Lines with code, without those of the docstring."""
    first = function.body[0]
    doc = set()
    if ast.get_docstring(function) is not None:
        doc = set(range(first.lineno, first.end_lineno + 1))
    return len({i for i in code if function.lineno <= i <= function.end_lineno} - doc)


@pytest.mark.parametrize(
    "path", FILES, ids=lambda path: str(path.relative_to(ROOT)).replace("/", ".")
)
def test_functions_are_short(path):
    source = path.read_text()
    code = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in NO_CODE:
            code.update(range(token.start[0], token.end[0] + 1))
    long = {
        node.name: lines_of_code(node, code)
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    }
    assert {name: n for name, n in long.items() if n > MOST_LINES} == {}


# -------------------------------------------------------------------- files of tests


@pytest.mark.parametrize("name", sorted(SLOW))
def test_files_that_are_slow_are_there(name):
    assert (TESTS / name).is_file()


MODULES = {
    path.stem: path
    for path in (PACKAGE / "_core").rglob("*.py")
    if path.stem != "__init__"
}


@pytest.mark.parametrize("name", sorted(MODULES))
def test_modules_of_the_core_have_a_test_file_of_their_name(name):
    path = TESTS / "core" / f"test_{name}.py"
    module = MODULES[name].relative_to(ROOT).with_suffix("").as_posix()
    assert imports_from(path, module.replace("/", "."))


def imports_from(path, module):
    """Whether a file imports a module, or something from it."""
    parent, _, name = module.rpartition(".")
    return any(
        isinstance(node, ast.ImportFrom)
        and (
            node.module == module
            or (node.module == parent and name in {a.name for a in node.names})
        )
        for node in ast.walk(ast.parse(path.read_text()))
    )


# -------------------------------------------------------------- signatures, docstrings


CALLABLES = {
    **{name: value for name, value in NAMES.items() if value not in CLASSES},
    **{
        f"{cls.__name__}.__init__": cls.__init__
        for cls in CLASSES
        if not issubclass(cls, tuple)  # whose fields are typed
    },
    **METHODS,
}


@pytest.mark.parametrize("name", CALLABLES)
def test_every_public_signature_is_typed(name):
    signature = inspect.signature(CALLABLES[name])
    assert signature.return_annotation is not signature.empty
    untyped = [
        each.name
        for each in signature.parameters.values()
        if each.annotation is each.empty and each.name not in ("self", "cls")
    ]
    assert untyped == []


@pytest.mark.parametrize("name", [*NAMES, *METHODS])
def test_docstrings_are_valid_by_numpydoc(name):
    validate = pytest.importorskip("numpydoc.validate", reason="needs numpydoc")
    value = NAMES[name] if name in NAMES else METHODS[name]
    path = f"{value.__module__}.{value.__qualname__}"
    errors = validate.validate(path)["errors"]
    assert [error for error in errors if error[0] in CHECKS] == []
