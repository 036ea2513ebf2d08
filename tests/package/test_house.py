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
