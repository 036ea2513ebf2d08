"""What one waits for who asks for the first time: nothing is compiled, or imported, that is not needed."""

import subprocess
import sys
import types

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import SCENES

import clearance_jax as cj
from clearance_jax._compile.solo import SOLO, solo_jit

# What is compiled after `ready`, and which of the large packages are there in the end.
COUNTED = """
import sys
import jax
import clearance_jax as cj
cj.configure()
programs = []
jax.monitoring.register_event_duration_secs_listener(
    lambda event, *_, **said: programs.append(said) if event.endswith("backend_compile_duration") else None
)
cj.load({path!r})
print(len(programs), *sorted({{"xarray", "pandas", "scipy", "matplotlib"}} & set(sys.modules)))
"""


def test_a_robot_is_loaded_without_a_program():
    code = COUNTED.format(path=str(SCENES / "six_axes.urdf"))
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert said.split() == ["0"]


@solo_jit
def _cubed(x):
    return {"cube": x**3, "word": "static"}


def test_a_solo_program_is_the_same_function_everywhere():
    x = jnp.linspace(0.5, 2.0, 4)
    assert _cubed(x)["word"] == "static"
    expected = np.asarray(x) ** 3
    together = jax.vmap(lambda x: _cubed(x)["cube"])
    for cube in (_cubed(x)["cube"], together(x), jax.jit(together)(x)):
        np.testing.assert_allclose(cube, expected, rtol=1e-15)
    slope = jax.grad(lambda x: _cubed(x)["cube"])
    for found in (slope(2.0), jax.jit(slope)(2.0)):
        assert float(found) == pytest.approx(12.0, rel=1e-15)


def test_a_solo_program_alone_has_options_of_its_own(monkeypatch):
    used = []
    monkeypatch.setattr(_cubed, "alone", lambda x: used.append("alone"))
    monkeypatch.setattr(_cubed, "within", lambda x: used.append("within"))
    _cubed(jnp.ones(()))
    jax.make_jaxpr(lambda x: _cubed(x) or x)(1.0)
    jax.vmap(lambda x: _cubed(x) or x)(jnp.ones(2))
    assert used == ["alone", "within", "within"]
    assert set(SOLO) == ({"xla_cpu_use_fusion_emitters"} if jax.__version_info__ < (0, 11) else set())


def test_methods_of_modules_are_ordinary_ones():
    mechanism = cj.load(SCENES / "slider_crank.toml")
    assert isinstance(mechanism.coordinates, types.MethodType)
    assert isinstance(mechanism.clearance_joints()[0].clearance.play, types.MethodType)
