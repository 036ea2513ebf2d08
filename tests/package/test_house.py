"""Names of the library: what a reader meets once must not mean two things, and a local must say what it holds."""

import ast
from collections import Counter

import pytest
from places import ROOT

pytestmark = pytest.mark.quick

MODULES = sorted((ROOT / "clearance_jax").rglob("*.py"))
TREES = {path: ast.parse(path.read_text(encoding="utf-8")) for path in MODULES}
# Words that say nothing of what they hold, and how often they may be assigned or be arguments.
EMPTY, MOST = {"found", "one", "own", "held", "said"}, 4


# Errors are told apart by their fields (`places.refused`); words are compared where the words are what matters.
MATCHED = 120


# The size of the house. The aims are 48 000 lines, modules of 350 and functions of 60 at most. What makes a number
# larger says why in its commit.
FILES, ROOT_MODULES, LINES = 329, 8, 55_301
IN_A_FOLDER, LONG_MODULE, LONG_FUNCTION = 20, 350, 60


def assigned(tree: ast.Module) -> list[str]:
    """The names that a module assigns, or has as arguments."""
    names = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.append(node.id)
        elif isinstance(node, ast.arg):
            names.append(node.arg)
    return names


def test_class_names_are_unique():
    counts = Counter(node.name for tree in TREES.values() for node in tree.body if isinstance(node, ast.ClassDef))
    assert len(counts) > 500
    assert {name for name, count in counts.items() if count > 1} == set()


def test_locals_say_what_they_hold():
    empty = [f"{path.name}: {name}" for path, tree in TREES.items() for name in assigned(tree) if name in EMPTY]
    assert len(empty) <= MOST, empty


@pytest.mark.parametrize("word", sorted(EMPTY))
def test_every_empty_word_is_seen(word):
    tree = ast.parse(f"def f(a, *, {word}):\n    {word} = a\n    return [{word} for {word} in a]")
    assert assigned(tree).count(word) == 3


def test_the_house_grows_no_rooms():
    """Fewer files and lines: what needs more first makes room."""
    assert len(MODULES) <= FILES
    assert len(list((ROOT / "clearance_jax").glob("*.py"))) <= ROOT_MODULES
    lengths = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in MODULES}
    assert 40_000 < sum(lengths.values()) <= LINES
    folders = Counter(path.parent for path in MODULES)
    assert {folder for folder, count in folders.items() if count > IN_A_FOLDER} == set()
    assert [str(path) for path, count in lengths.items() if count > LONG_MODULE] == []


def code_lines(function: ast.FunctionDef) -> int:
    """The lines of a function without its docstring."""
    documented = ast.get_docstring(function) is not None
    text = function.body[0]
    lines = (function.end_lineno or 0) - function.lineno + 1
    return lines - ((text.end_lineno or 0) - text.lineno + 1) * documented


def test_functions_are_short():
    functions = [node for tree in TREES.values() for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    assert len(functions) > 3000
    assert [node.name for node in functions if code_lines(node) > LONG_FUNCTION] == []


def test_lines_of_functions_are_counted():
    (function,) = ast.parse('def f(a):\n    """What.\n\n    More.\n    """\n    b = a\n    return b').body
    assert isinstance(function, ast.FunctionDef)
    assert code_lines(function) == 3


def test_errors_are_known_by_their_fields():
    words = "match" + "="
    lines = [line for path in (ROOT / "tests").rglob("*.py") for line in path.read_text(encoding="utf-8").splitlines()]
    assert len(lines) > 20_000
    assert sum(words in line for line in lines) <= MATCHED
