"""Forward dynamics by MuJoCo and pinocchio: run by an interpreter that has `mujoco` and `pin`, not by this project's.

Reads from the standard input an arm as URDF text, and positions and rates of many states (JSON); writes what an
evaluation takes [s], called from Python at one state after the other (the shortest of several rounds), and the
accelerations.
"""

import json
import sys
import time

import numpy as np

ROUNDS = 50


def shortest(call, states):
    """The mean of a round over all states, of the shortest round."""
    times = []
    for _ in range(ROUNDS):
        clock = time.perf_counter()
        for q, v in states:
            call(q, v)
        times.append((time.perf_counter() - clock) / len(states))
    return min(times)


def by_pinocchio(urdf, states):
    import pinocchio as pin

    # A turn without limits would have two coordinates, cosine and sine.
    model = pin.buildModelFromXML(urdf.replace('type="continuous"', 'type="revolute"').replace(*LIMITS))
    data, effort = model.createData(), np.zeros(model.nv)
    found = [pin.aba(model, data, q, v, effort).tolist() for q, v in states]
    cost = shortest(lambda q, v: pin.aba(model, data, q, v, effort), states)
    return f"pinocchio {pin.__version__}, `aba`", cost, found


def by_mujoco(urdf, states):
    import mujoco

    model = mujoco.MjModel.from_xml_string(urdf)
    data = mujoco.MjData(model)

    def call(q, v):
        data.qpos[:] = q
        data.qvel[:] = v
        mujoco.mj_forward(model, data)
        return data.qacc

    found = [call(q, v).tolist() for q, v in states]
    return f"MuJoCo {mujoco.__version__}, `mj_forward`", shortest(call, states), found


LIMITS = '<axis xyz="0 0 1"/>', '<axis xyz="0 0 1"/><limit lower="-9" upper="9" velocity="9" effort="9"/>'
PROGRAMS = {"mujoco": by_mujoco, "pin": by_pinocchio}

if __name__ == "__main__":
    given = json.load(sys.stdin)
    states = [(np.array(q), np.array(v)) for q, v in zip(given["q"], given["v"], strict=True)]
    measured, missing = [], []
    for name, program in PROGRAMS.items():
        try:
            called, cost, found = program(given["urdf"], states)
        except ModuleNotFoundError:
            missing.append(name)
            continue
        measured.append({"program": called, "seconds": cost, "accelerations": found})
    json.dump({"measured": measured, "missing": missing}, sys.stdout)
