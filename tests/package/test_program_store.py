"""Programs that are kept between processes: the right answer whatever lies in the folder, and another key for whatever
a program depends on. New `kept_jit` objects stand for new processes.
"""

import functools
import inspect
import os
import subprocess
import sys
import textwrap
import threading
import types
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from equinox import _config as equinox_config
from typer.testing import CliRunner

import clearance_jax as cj
from clearance_jax._compile import files, kept, library
from clearance_jax._compile.kept import keep_in, kept_jit
from clearance_jax._compile.private import WholeEntries
from clearance_jax._compile.runtime import RUNTIME
from clearance_jax._compile.structure import Reader, Untold
from clearance_jax.cli.main import app
from clearance_jax.laws import HuntCrossley
from clearance_jax.mechanism._base import AbstractMechanism
from clearance_jax.solve.flow import compiled_solve
from clearance_jax.solve.steps import control

PROGRAM = """
import sys
import textwrap
import clearance_jax as cj
cj.configure(cache=sys.argv[1])
import jax.numpy as jnp
from clearance_jax._compile.kept import kept_jit
from clearance_jax._compile.library import surroundings

def function(x, power):
    print("traced")
    return {"y": jnp.linalg.solve(x, x[0]) ** power, "said": power}

out = kept_jit(function)(jnp.eye(3) * 2 + 1, 2)
print(out["y"].tolist(), out["said"])
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("CLEARANCE_KEPT", "1")
    RUNTIME.altered.clear()  # other tests may have patched the library
    keep_in(tmp_path / "programs")
    yield tmp_path / "programs"
    keep_in(None)


def run(folder, flags=""):
    env = os.environ | {"CLEARANCE_KEPT": "1", "XLA_FLAGS": flags}
    done = subprocess.run([sys.executable, "-c", PROGRAM, str(folder)], capture_output=True, text=True, env=env)
    assert done.returncode == 0, done.stderr
    *traced, answer = done.stdout.splitlines()
    return bool(traced), answer


@pytest.mark.slow
def test_a_second_process_traces_nothing_unless_flags_differ(tmp_path):
    first, answer = run(tmp_path)
    assert first
    assert run(tmp_path) == (False, answer)
    assert run(tmp_path, "--xla_cpu_prefer_vector_width=128") == (True, answer)
    assert len(list((tmp_path / "programs").iterdir())) == 2


TRACED = []


def summed(x, power):
    TRACED.append(power)
    return {"y": jnp.sum(x**power), "power": power}


def fresh(x=3.0):
    """What a new process makes of it, and whether it traced."""
    TRACED.clear()
    out = kept_jit(summed)(jnp.asarray([x, 2.0]), 2)
    assert out["power"] == 2
    return float(out["y"]), bool(TRACED)


def damaged(path):
    whole = path.read_bytes()
    yield path, whole[: len(whole) // 2]
    yield path, b""
    yield path, b"no program"
    middle = len(whole) // 2
    yield path, whole[:middle] + bytes([whole[middle] ^ 1]) + whole[middle + 1 :]


def test_a_damaged_or_strange_entry_is_ignored(folder):
    assert fresh() == (13.0, True)
    assert fresh(4.0) == (20.0, False)
    (path,) = folder.iterdir()
    for where, content in damaged(path):
        where.write_bytes(content)
        assert fresh() == (13.0, True)
        assert fresh() == (13.0, False)
    # Whole, but of another version, or of another program.
    for content in (b"not even pickled", b"\x80\x04K\x01."):
        files.write(folder, path.stem, content)
        assert fresh() == (13.0, True)
    whole = path.read_bytes()
    path.rename(folder / f"{'0' * 32}.program")
    path.write_bytes(whole.replace(files._digest(path.stem, whole), b""))
    (folder / f"{'0' * 32}.program").replace(path)
    assert fresh() == (13.0, False)
    path.unlink()
    path.mkdir()  # as a file that cannot be read
    assert fresh() == (13.0, True)


def test_a_file_under_the_name_of_another_is_not_read(folder):
    files.write(folder, "one", b"content")
    (folder / "one.program").rename(folder / "two.program")
    assert files.read(folder, "two") is None


def test_a_folder_that_others_can_write_to_is_not_used(folder, monkeypatch):
    assert fresh() == (13.0, True)
    folder.chmod(0o777)
    assert fresh() == (13.0, True)  # it became so while a process ran
    with pytest.warns(UserWarning, match="must be writable by its owner alone, but others than its owner can write"):
        keep_in(folder)
    assert not RUNTIME.folder
    folder.chmod(0o700)
    (next(folder.iterdir())).chmod(0o666)
    assert files.read(folder, next(folder.iterdir()).stem) is None
    monkeypatch.setenv("CLEARANCE_KEPT", "0")
    keep_in(folder)
    assert not RUNTIME.folder


def test_where_nothing_can_be_written_programs_are_compiled(folder):
    folder.write_text("a file in its place")
    assert fresh()[0] == 13.0
    assert folder.read_text() == "a file in its place"


def test_what_was_used_last_goes_last(tmp_path):
    for k in range(4):
        files.write(tmp_path, str(k), bytes(1000))
        os.utime(tmp_path / f"{k}.program", (k, k))
    assert files.read(tmp_path, "0") is not None
    files.write(tmp_path, "4", bytes(1000), largest=4000)
    assert sorted(path.stem for path in tmp_path.iterdir()) == ["0", "3", "4"]


def test_many_may_write_at_once(tmp_path):
    def write(k):
        for _ in range(20):
            assert files.write(tmp_path, "same", bytes([k]) * 100_000)
            content = files.read(tmp_path, "same")
            assert content is not None
            assert len(set(content)) == 1

    threads = [threading.Thread(target=write, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [path.name for path in tmp_path.iterdir()] == ["same.program"]


# The key -------------------------------------------------------------------------------------------------------------


def user(source, name="mine"):
    """A module as a user's script is one."""
    module = types.ModuleType(name)
    exec(compile(source, f"{name}.py", "exec"), module.__dict__)
    return module


LAW = """
import equinox as eqx
FACTOR = 2.0
def helper(x):
    return FACTOR * x
class Law(eqx.Module):
    width: float = eqx.field(static=True, default=1.0)
    def force(self, x):
        return 3.0 * helper(x) * self.width
def maker(value):
    def inner(x):
        return value * x
    return inner
"""


def key(*arguments):
    leaves, tree = jax.tree.flatten(arguments)
    return kept_jit(summed)._key(leaves, tree)


def text(value):
    """The text of a value for a key."""
    reader = Reader(strict=True)
    return reader.whole(reader.of(value))


def described(value):
    """The text of a value for a question of a sweep, which the user's code is part of."""
    reader = Reader()
    return reader.whole(reader.of(value))


def test_code_of_the_users_is_part_of_a_question():
    mine = user(LAW)
    usual = described(mine.Law())
    assert described(user(LAW).Law()) == usual
    others = [
        user(LAW.replace("3.0", "4.0")).Law(),  # the same name, another code
        user(LAW.replace("FACTOR = 2.0", "FACTOR = 2.5")).Law(),
        user(LAW.replace("return FACTOR * x", "return FACTOR + x")).Law(),
        user(LAW.replace("class Law(eqx.Module):", "class Law(eqx.Module):\n    other = 1")).Law(),
        user(LAW.replace("def force", "def _flatten")).Law(),
        user(LAW.replace("def force", "def _flatten").replace("3.0", "4.0")).Law(),
        mine.Law(width=2.0),
    ]
    mine.__dict__["FACTOR"] = 5.0  # a global that is changed later
    found = [usual, described(mine.Law()), *map(described, others)]
    mine.Law.force = lambda self, x: x
    found.append(described(mine.Law()))
    assert len(set(found)) == len(found)
    mine = user(LAW)
    functions = [
        mine.maker(1.0),
        mine.maker(1.5),
        mine.helper,
        functools.partial(mine.helper, 1.0),
        jax.jit(mine.helper),
    ]
    functions.append(functools.wraps(textwrap.dedent)(user(LAW).helper))  # which then says that it is another
    functions += [textwrap.dedent, jnp.sin, jax.custom_jvp(mine.maker(1.0))]
    keys = [described(one) for one in functions]
    assert len(set(keys)) == len(keys)
    assert described(mine.maker(1.0)) == keys[0]


def test_a_rule_of_differentiation_is_part_of_a_question():
    source = (
        "import jax\n@jax.custom_jvp\ndef f(x):\n    return x\n@f.defjvp\ndef _(p, t):\n    return p[0], 2.0 * t[0]\n"
    )
    assert described(user(source).f) == described(user(source).f)
    assert described(user(source).f) != described(user(source.replace("2.0", "3.0")).f)


def test_structure_and_kinds_of_arguments_are_part_of_the_key():
    x = jnp.ones(2)
    found = [
        key(x, 1),
        key(x, 2),
        key(x, True),
        key(x, 1.0),
        key(1, x),
        key((x, 1)),
        key([x, 1]),
        key({"a": x, "b": 1}),
    ]
    found += [key({"a": x, "c": 1}), key(jnp.ones(3), 1), key(jnp.ones(2, int), 1), key(jnp.ones(()), 1), key(x, "1")]
    found += [key(jnp.asarray(1.0), 1), key(x, None), key(x, x), key(x, 0.0), key(x, -0.0)]
    assert len(set(found)) == len(found)
    assert key(jnp.zeros(2), 1) == found[0]


def test_a_program_of_a_call_is_not_that_of_an_equal_one(folder):
    """1, 1.0 and True are equal to Python, and so are the two zeros."""
    twice = kept_jit(summed)
    x = jnp.asarray([3.0, 2.0])
    for power in (1, 1.0, True, 0.0, -0.0):
        assert str(twice(x, power)["power"]) == str(power)


def test_surroundings_are_part_of_the_key(monkeypatch):
    usual, found = key(1), []
    with jax.enable_x64(False):
        found.append(key(1))
    with jax.default_matmul_precision("float32"):
        found.append(key(1))
    for name in ("source_digest", "processor", "_versions", "_flags"):
        with monkeypatch.context() as patch:
            patch.setattr(library, name, lambda: "another")
            found.append(key(1))
    with monkeypatch.context() as patch:
        patch.setattr(kept, "SOLO", {"xla_cpu_use_fusion_emitters": "another"})
        found.append(key(1))
    with monkeypatch.context() as patch:
        patch.setattr(equinox_config, "EQX_ON_ERROR", "nan")
        found.append(key(1))
    assert len({usual, *found}) == 9
    assert key(1) == usual


@pytest.mark.slow
def test_the_library_as_it_stands_in_memory_is_part_of_the_key(monkeypatch):
    def solved():
        return compiled_solve._key([], jax.tree.structure(()))

    usual = solved()
    for where, name, value in ((control, "SAFETY_OF_THE_TEST", 0.5), (HuntCrossley, "NUMBER_OF_THE_TEST", 1.0)):
        with monkeypatch.context() as patch:
            patch.setattr(where, name, value, raising=False)
            assert solved() != usual
        assert solved() == usual
    # What code of the user's reads and remembers, no key can tell.
    for where, name, value in (
        (HuntCrossley, "force_rate_of_the_test", lambda self: 1.0),
        (control, "judged", functools.wraps(control.judge)(lambda *given: given)),
        (cj.RevoluteClearance, "prepared", lambda self: self),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(where, name, value, raising=False)
            with pytest.raises(Untold) as untold:
                solved()
            assert "code of the user's" in str(untold.value)
        assert solved() == usual


def test_a_property_of_the_librarys_that_is_replaced_is_seen(monkeypatch):
    def solved():
        return compiled_solve._key([], jax.tree.structure(()))

    usual = solved()
    for where, name in ((AbstractMechanism, "is_plane"), (AbstractMechanism, "may_repeat")):
        own = vars(where)[name]
        kind = type(own)
        formula = own.fget if isinstance(own, property) else own.function
        with monkeypatch.context() as patch:
            patch.setattr(where, name, kind(control.factor))
            assert solved() != usual
            for other in (property(lambda self: True), kind(lambda self: True), property(formula, lambda *_: None)):
                patch.setattr(where, name, other)
                with pytest.raises(Untold, match="code of the user's"):
                    solved()
        with monkeypatch.context() as patch:
            assert formula is not None
            code = formula.__code__
            patch.setattr(formula, "__code__", code.replace(co_consts=(*code.co_consts, 7.5)))
            assert solved() != usual
        assert solved() == usual


HISTORY = """
import importlib, pkgutil, sys
import jax
import clearance_jax as cj
from clearance_jax._compile import kept, library
from clearance_jax._compile.runtime import RUNTIME
from clearance_jax._compile.kept import kept_jit

class Told(Exception):
    pass

def key():
    RUNTIME.modules.clear()
    kept_jit._key, own = lambda *given: (_ for _ in ()).throw(Told(own(*given))), kept_jit._key
    try:
        cj.simulate(cj.load(sys.argv[1]), 1e-3)
    except Told as told:
        return str(told)
    finally:
        kept_jit._key = own

def libraries():
    for module in pkgutil.walk_packages(cj.__path__, "clearance_jax."):
        importlib.import_module(module.name)

def others():
    import experiments.needs
    import numpy.ctypeslib, numpy.ma, numpy.polynomial, numpy.random, numpy.testing, scipy.optimize

def traced():
    mechanism = cj.load(sys.argv[1])
    jax.eval_shape(lambda x: cj.simulate(cj.replace(mechanism, {"conrod.mass": x}), 1e-3).final, 1.0)

cj.configure(cache=sys.argv[2])
before = [traced, others, libraries] if sys.argv[3] == "much" else []
for load in before:
    load()
keys = [key()]
for load in before or [libraries, traced, others]:
    load()
    keys.append(key())
print(*sorted(set(keys)), *RUNTIME.altered)
"""


@pytest.mark.slow
def test_the_key_does_not_depend_on_what_was_loaded_and_asked_before(tmp_path):
    def keys(before):
        call = [sys.executable, "-c", HISTORY, "experiments/scenes/slider_crank.toml", str(tmp_path), before]
        done = subprocess.run(call, capture_output=True, text=True, env=os.environ | {"CLEARANCE_KEPT": "1"})
        assert done.returncode == 0, done.stderr
        return done.stdout.split()

    first = keys("nothing")
    assert len(first) == 1
    assert keys("much") == first


@pytest.mark.parametrize("value", [control.factor, vars(cj.RevoluteClearance)["travel"]], ids=["function", "method"])
def test_what_is_written_anew_in_its_place_is_seen(value, monkeypatch):
    """As an editor that reloads does."""
    usual = compiled_solve._key([], jax.tree.structure(()))
    formula = inspect.unwrap(getattr(value, "method", value))
    own = formula.__code__
    with monkeypatch.context() as patch:
        patch.setattr(formula, "__code__", own.replace(co_consts=(*own.co_consts, 7.5)))
        assert compiled_solve._key([], jax.tree.structure(())) != usual
    assert compiled_solve._key([], jax.tree.structure(())) == usual


# Holes that a key might have ----------------------------------------------------------------------------------------


def told(source):
    """The text of what a user's module has made."""
    return described(user(source).__dict__["made"])


FIELD = """
import dataclasses
import equinox as eqx
class Law(eqx.Module):
    width: float = eqx.field(converter=lambda x: 2.0 * x, default_factory=lambda: 1.0)
made = Law
"""
HIDDEN = """
class Table(list):
    scale = 1.0
made = Table([1.0])
made.factor = 2.0
"""
MASKED = "import numpy as np\nmade = np.ma.MaskedArray([1.0, 2.0], mask=[True, False])\n"
ENUM = "import enum\nclass Kind(enum.Enum):\n    A = [1.0]\nmade = Kind.A\n"
META = "class Meta(type):\n    def other(cls):\n        return 1.0\nclass Law(metaclass=Meta):\n    pass\nmade = Law\n"
DEFAULTS = "def made(x, *, y=1.0):\n    return x\n"
PARTIAL = "import functools\ndef f(x, y):\n    return x\nmade = functools.partial(f, y=1.0)\n"
CONSTANT = (
    "import numpy as np\ndef maker():\n    table = np.array([1.0, 2.0])\n    return lambda x: table * x\n"
    "made = maker()\n"
)
INHERITED = "class Base:\n    def f(self):\n        return 1.0\nclass Law(Base):\n    pass\nmade = Law\n"
BEFORE = [FIELD, FIELD, HIDDEN, HIDDEN, MASKED, ENUM, META, DEFAULTS, PARTIAL, CONSTANT, INHERITED]
CHANGES = [
    ("2.0 * x", "3.0 * x"),
    ("lambda: 1.0", "lambda: 1.5"),
    ("factor = 2.0", "factor = 3.0"),
    ("scale = 1.0", "scale = 2.0"),
    ("True, False", "False, False"),
    ("[1.0]", "[2.0]"),
    ("return 1.0", "return 2.0"),
    ("y=1.0", "y=2.0"),
    ("y=1.0", "y=2.0"),
    ("2.0]", "3.0]"),
    ("return 1.0", "return 2.0"),
]


@pytest.mark.parametrize(("source", "change"), list(zip(BEFORE, CHANGES, strict=True)))
def test_every_part_of_what_the_user_wrote_is_part_of_a_question(source, change):
    assert change[0] in source
    assert told(source) == told(source)
    assert told(source) != told(source.replace(*change))


OWN = [
    LAW + "made = Law()\n",
    LAW + "made = helper\n",
    LAW + "import functools\nmade = functools.partial(helper, 1.0)\n",
    LAW + "import jax\nmade = jax.jit(helper)\n",
    "import numpy as np\nmade = np.frompyfunc(lambda x: 2.0 * x, 1, 1)\n",
    "import functools\n@functools.cache\ndef made():\n    return 1.0\n",
    "from pathlib import Path\nmade = Path('table.csv').read_text\n",
]


@pytest.mark.parametrize("source", OWN)
def test_code_of_the_users_is_compiled_in_each_process(source):
    """What it reads, calls and remembers no key can tell: a file read behind a cache, or a global that is changed."""
    with pytest.raises(Untold):
        text(user(source).__dict__["made"])
    with pytest.raises(Untold):
        key(user(source).__dict__["made"])


def test_a_class_whose_parts_other_code_takes_apart_is_not_kept():
    mine = user("class Pair:\n    def __init__(self, x):\n        self.x = x\n")
    jax.tree_util.register_pytree_node(mine.Pair, lambda pair: ((2.0 * pair.x,), None), lambda _, x: mine.Pair(*x))
    with pytest.raises(Untold):
        key(mine.Pair(1.0))


def test_a_law_that_reads_a_file_behind_a_cache_is_right_in_each_process(folder, tmp_path):
    """The second program is traced where the file has been read already: nothing opens it any more."""
    path = tmp_path / "table.txt"
    source = "import functools\nimport numpy as np\n@functools.cache\n"
    source += "def factor():\n    return float(np.loadtxt(PATH))\ndef law(x):\n    return factor() * x\n"

    def asked(x, law):
        return law(x)

    for factor in (2.0, 3.0):
        path.write_text(str(factor))
        mine = user(source)
        mine.__dict__["PATH"] = path
        for shape in ((), (2,)):
            assert float(jnp.max(kept_jit(asked)(jnp.ones(shape), mine.law))) == factor
    assert not folder.exists()


def test_what_is_written_in_c_may_say_anything_of_itself():
    """The class of a function of Cython has no text for its module."""
    reader = Reader()
    assert reader.of(type(np.random.default_rng))
    mine = user("from numpy.random import default_rng\ndef made(x):\n    return default_rng(1).normal() * x\n")
    assert described(mine.made) == described(mine.made)


def test_what_the_library_was_patched_with_is_not_kept_later(folder, monkeypatch):
    """Even if a mapped program, which is not kept, was all that was traced with the patch."""
    inner = kept_jit(lambda x: x + 1.0, made_of=(compiled_solve.function,))
    assert fresh() == (13.0, True)
    with monkeypatch.context() as patch:
        patch.setattr(control, "SAFETY_OF_THE_TEST", 0.5, raising=False)
        jax.vmap(inner)(jnp.ones(2))
    assert inner(jnp.ones(2))[0] == 2.0
    assert RUNTIME.altered == {"clearance_jax.solve.steps.control"}
    assert len(list(folder.iterdir())) == 1


class Slotted:
    __slots__ = ("x",)


STRANGE = [threading.Lock(), Slotted(), user("x = 1"), iter([1]), types.new_class("Local")]


@pytest.mark.parametrize("value", STRANGE, ids=lambda x: type(x).__name__)
def test_what_cannot_be_read_is_not_kept(value):
    if isinstance(value, type):
        value.__module__ = "numpy"  # it says so, but is not found there
    with pytest.raises(Untold):
        text(value)


def test_a_value_within_itself_ends():
    loop = [1]
    loop.append(loop)
    other = [2]
    other.append(other)
    assert text(loop) != text(other)
    assert text([loop, loop]) == text([loop, loop])


# What is kept --------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_simulation_and_its_derivative_are_kept(folder, monkeypatch):
    """Samples, a failing solve, and a gradient by a program that another process made; the same bits as without."""
    mechanism = cj.load("experiments/scenes/joint5_velocity_1.toml")

    def asked():
        solution = cj.simulate(mechanism, 1e-3, save_at=5, rtol=1e-5)
        slope = jax.grad(lambda x: cj.simulate(cj.replace(mechanism, {"gravity.y": x}), 1e-3, rtol=1e-5).final[0])(
            -9.81
        )
        return solution, slope

    kept = asked()
    made = len(list(folder.iterdir()))
    assert made == 2
    for program in (compiled_solve._programs, compiled_solve._calls):
        program.clear()
    monkeypatch.setattr(kept_jit, "_compile", None)  # nothing is to be traced
    again = asked()
    assert eqx.tree_equal(kept, again)
    keep_in(None)
    assert eqx.tree_equal(kept, asked())


def test_two_programs_are_made_side_by_side_and_each_once(folder, monkeypatch):
    """Each is traced while the other is: one lock for both would end the meeting."""
    meeting, x = threading.Barrier(2, timeout=60), jnp.asarray([3.0, 2.0])

    class Traced(list):
        def append(self, power):
            super().append(power)
            meeting.wait()

    monkeypatch.setattr(sys.modules[__name__], "TRACED", Traced())
    program = kept_jit(summed)
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(lambda power: float(program(x, power)["y"]), (2, 3, 2, 3))) == [13.0, 35.0, 13.0, 35.0]
    assert sorted(TRACED) == [2, 3]
    assert [float(kept_jit(summed)(x, power)["y"]) for power in (2, 3)] == [13.0, 35.0]
    assert sorted(TRACED) == [2, 3]


# Programs that are kept, and others beside them in a second thread, in a process whose JAX has a cache.
BESIDE = """
import sys
import threading
import clearance_jax as cj
cj.configure(cache=sys.argv[1])
import jax, jax.numpy as jnp
from clearance_jax._compile.kept import kept_jit

def function(x, power):
    return jnp.sin(x) ** power

def usual(x):
    return jnp.cos(x) ** 3

program, meeting = kept_jit(function), threading.Barrier(2)

def keep():
    for power in range(20):
        meeting.wait()
        program(jnp.arange(3.0), power)

thread = threading.Thread(target=keep)
thread.start()
for power in range(20):
    meeting.wait()
    jax.jit(lambda x, power=power: usual(x) + power).lower(jnp.arange(3.0)).compile()
thread.join()
"""


@pytest.mark.slow
def test_only_kept_programs_pass_by_jaxs_cache(tmp_path):
    """A kept program that came from JAX's cache would lack functions; the others, made meanwhile, are to be there."""
    env = {name: value for name, value in os.environ.items() if name != "JAX_COMPILATION_CACHE_DIR"}
    env |= {"CLEARANCE_KEPT": "1"}
    subprocess.run([sys.executable, "-c", BESIDE, str(tmp_path)], check=True, env=env)
    assert len(list((tmp_path / "programs").glob("*.program"))) == 20
    names = [path.name for path in tmp_path.glob("*-cache")]
    assert sum("lambda" in name for name in names) == 20
    assert not [name for name in names if name.startswith("jit_flat")]


def test_within_a_program_or_mapped_calls_are_traced(folder):
    twice = kept_jit(summed)
    x = jnp.asarray([[3.0, 2.0], [1.0, 1.0]])
    np.testing.assert_array_equal(jax.vmap(lambda row: twice(row, 2)["y"])(x), [13.0, 2.0])
    assert float(jax.jit(lambda row: twice(row, 2)["y"])(x[0])) == 13.0
    np.testing.assert_array_equal(jax.grad(lambda row: twice(row, 2)["y"])(x[0]), [6.0, 4.0])
    assert not folder.exists()


def test_what_calls_python_is_compiled_as_usual(folder):
    def called(x):
        return jax.pure_callback(lambda x: x + 1, jax.ShapeDtypeStruct((), float), x)

    assert float(kept_jit(called)(jnp.asarray(1.0))) == 2.0
    assert not folder.exists()


def test_the_command_shows_and_empties_what_is_kept(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path / "jax"))
    programs = tmp_path / "clearance_jax" / "programs"
    files.write(programs, "one", bytes(3 << 20))
    (tmp_path / "jax").mkdir()
    for name in ("jit_f-123-cache", "jit_f-123-atime", ".jit_f-123-cache.0.partial", "a thesis.txt"):
        (tmp_path / "jax" / name).write_text("content")
    (programs / "mine.txt").write_text("of the user's")
    shown = CliRunner().invoke(app, ["cache"]).output
    assert f"{programs}: 1 programs, 3.0 MiB of at most 1.0 GiB" in shown
    assert f"{tmp_path / 'jax'}: 1 programs" in shown
    assert "removed 2 programs, 3.0 MiB" in CliRunner().invoke(app, ["cache", "--clear"]).output
    assert [path.name for path in programs.iterdir()] == ["mine.txt"]
    assert [path.name for path in (tmp_path / "jax").iterdir()] == ["a thesis.txt"]
    assert f"{programs}: 0 programs" in CliRunner().invoke(app, ["cache"]).output


# A process of its own, with JAX's cache in a folder: warnings are errors.
CACHED = """
import sys
import clearance_jax as cj
cj.configure(cache=sys.argv[1])
import jax, jax.numpy as jnp
from jax._src import monitoring
hits = []
monitoring.register_event_listener(lambda event, **_: hits.append(event))
sys.stdin.readline()
for power in range(int(sys.argv[2])):
    jax.jit(lambda x: jnp.sin(x) ** power + power)(jnp.arange(3.0)).block_until_ready()
print(hits.count("/jax/compilation_cache/cache_hits"), hits.count("/jax/compilation_cache/cache_misses"))
"""


def cached(folder, programs, count=1):
    """What `count` processes that begin together say: how many programs each found in the folder, and compiled."""
    env = {name: value for name, value in os.environ.items() if name != "JAX_COMPILATION_CACHE_DIR"}
    call = [sys.executable, "-W", "error", "-c", CACHED, str(folder), str(programs)]
    pipes: Any = {name: subprocess.PIPE for name in ("stdin", "stdout", "stderr")}
    began = [subprocess.Popen(call, text=True, env=env, **pipes) for _ in range(count)]
    said = [process.communicate("go\n") for process in began]
    assert not any(process.returncode for process in began), said
    return [tuple(map(int, out.split())) for out, _ in said]


@pytest.mark.slow
def test_what_of_jaxs_cache_cannot_be_read_is_compiled_anew(tmp_path):
    ((_, compiled),) = cached(tmp_path, 1)
    entries = sorted(tmp_path.glob("*-cache"))
    assert len(entries) == compiled > 0
    whole = {path: path.read_bytes() for path in entries}
    for path, content in whole.items():
        path.write_bytes(content[: len(content) // 2])
    assert cached(tmp_path, 1) == [(0, compiled)]
    assert cached(tmp_path, 1) == [(compiled, 0)]
    assert sorted(tmp_path.glob("*-cache")) == entries


@pytest.mark.slow
def test_two_processes_may_begin_together_with_an_empty_cache(tmp_path):
    programs = 40
    found = cached(tmp_path, programs, count=2)
    assert all(hits + misses >= programs for hits, misses in found)
    ((hits, misses),) = cached(tmp_path, programs)
    assert misses == 0
    assert len(list(tmp_path.glob("*-cache"))) == hits
    assert not list(tmp_path.glob("*.partial"))


def test_an_entry_gets_its_name_when_it_is_whole(tmp_path, monkeypatch):
    seen = []
    replace = os.replace
    monkeypatch.setattr(os, "replace", lambda part, path: (seen.append(path.exists()), replace(part, path)))
    WholeEntries(str(tmp_path), max_size=-1).put("key", b"content")
    assert seen == [False]
    assert [path.name for path in tmp_path.iterdir()] == ["key-cache"]
    monkeypatch.setattr(os, "replace", lambda *_: (_ for _ in ()).throw(OSError("no space")))
    with pytest.raises(OSError, match="no space"):
        WholeEntries(str(tmp_path), max_size=-1).put("other", b"content")
    assert [path.name for path in tmp_path.iterdir()] == ["key-cache"]
