"""Programs that are kept between processes: the right answer whatever lies in the folder."""

import os
import subprocess
import sys

PROGRAM = """
import sys
import clearance_jax as cj
cj.configure(cache=sys.argv[1])
import jax.numpy as jnp
from clearance_jax._kept import kept_jit

def function(x, power):
    print("traced")
    return {"y": jnp.linalg.solve(x, x[0]) ** power, "said": power}

out = kept_jit(function)(jnp.eye(3) * 2 + 1, 2)
print(out["y"].tolist(), out["said"])
"""


def run(folder):
    env = os.environ | {"CLEARANCE_KEPT": "1"}
    done = subprocess.run([sys.executable, "-c", PROGRAM, str(folder)], capture_output=True, text=True, env=env)
    assert done.returncode == 0, done.stderr
    *traced, answer = done.stdout.splitlines()
    return bool(traced), answer


def test_a_second_process_traces_nothing_and_a_damaged_file_is_ignored(tmp_path):
    first, answer = run(tmp_path)
    assert first
    assert run(tmp_path) == (False, answer)
    (file,) = (tmp_path / "programs").iterdir()
    file.write_bytes(file.read_bytes()[:-100])
    assert run(tmp_path) == (True, answer)
