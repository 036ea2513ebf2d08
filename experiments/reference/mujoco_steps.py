"""What MuJoCo takes to step an arm: run by an interpreter that has `mujoco`, not by this project's.

Reads from the standard input an arm as URDF text, a step size [s], how many steps, and where its joints start (JSON);
writes the shortest time of several runs [s].
"""

import json
import sys
import time

import mujoco
import numpy as np

ROUNDS = 7

given = json.load(sys.stdin)
model = mujoco.MjModel.from_xml_string(given["urdf"])
model.opt.timestep = given["step"]
data, times = mujoco.MjData(model), []
for _ in range(ROUNDS):
    mujoco.mj_resetData(model, data)
    data.qpos[: len(given["q"])] = np.array(given["q"])
    clock = time.perf_counter()
    mujoco.mj_step(model, data, nstep=given["steps"])
    times.append(time.perf_counter() - clock)
print(json.dumps({"program": f"MuJoCo {mujoco.__version__}", "seconds": min(times), "joints": model.nv}))
