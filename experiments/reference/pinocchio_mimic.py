"""Robots whose joints follow others, by pinocchio: run by an interpreter that has `pin`, not by this project's.

`PYTHON pinocchio_mimic.py FILE STATES SEED OUT`: OUT (.npz) has, of random states of the joints that follow none, the
accelerations under gravity and the joints' damping and dry friction. They are those of pinocchio's model with
`mimic=True`. Pinocchio refuses a joint that follows a later one, or one that follows itself another. Then the followers
are eliminated from its model of free joints by v = G v_left. Where pinocchio has both, `apart` is their difference.
"""

import re
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pinocchio as pin
from pinocchio_robots import TURNING


def relations(path, moving):
    """By follower its leader, the ratio and the offset."""
    # Prefixes of elements that no file declares are not XML.
    text = re.sub(r"<(/?)\w+:", r"<\1", Path(path).read_text(encoding="utf-8", errors="replace"))
    out = {}
    for joint in ElementTree.fromstring(text.encode()).findall("joint"):
        mimic = joint.find("mimic")
        if mimic is not None and joint.get("name") in moving and mimic.get("joint") in moving:
            numbers = float(mimic.get("multiplier", 1.0)), float(mimic.get("offset", 0.0))
            out[joint.get("name")] = (mimic.get("joint"), *numbers)
    return out


def of_root(name, known, seen=()):
    """The joint that a joint follows in the end, the ratio and the offset."""
    if name in seen:
        raise SystemExit(f"The joints {', '.join(seen)} follow one another.")
    if name not in known:
        return name, 1.0, 0.0
    leader, ratio, offset = known[name]
    root, further, shift = of_root(leader, known, (*seen, name))
    return root, ratio * further, ratio * shift + offset


def configuration(model, places):
    """Pinocchio's configuration by the joints' places: an endless turn is a cosine and a sine."""
    q = np.zeros(model.nq)
    for joint, name in list(zip(model.joints, model.names, strict=True))[1:]:
        if joint.nq == 1:
            q[joint.idx_q] = places[name]
        elif joint.nq == 2:
            q[joint.idx_q : joint.idx_q + 2] = np.cos(places[name]), np.sin(places[name])
        elif joint.nq:
            raise SystemExit(f"The joint {name} has several coordinates.")
    return q


def solved(model, data, q, v, effort):
    """Accelerations by the mass matrix: articulated bodies know no followers."""
    bias = pin.nonLinearEffects(model, data, q, v).copy()
    mass = pin.crba(model, data, q).copy()
    mass = np.triu(mass) + np.triu(mass, 1).T
    if np.linalg.matrix_rank(mass) < model.nv:
        raise SystemExit("The mass matrix is singular: some motion moves no mass.")
    return mass, bias, np.linalg.solve(mass, effort - bias)


def with_followers(path):
    """Pinocchio's model, or nothing where it refuses."""
    try:
        return pin.buildModelFromUrdf(path, mimic=True)
    except (RuntimeError, ValueError):
        return None


def main(path, states, seed, out):
    whole, model = pin.buildModelFromUrdf(path), with_followers(path)
    moving = list(whole.names)[1:]
    known = relations(path, moving)
    left = [name for name in moving if name not in known]
    roots = {name: of_root(name, known) for name in moving}
    g = np.zeros((whole.nv, len(left)))
    for joint, name in list(zip(whole.joints, whole.names, strict=True))[1:]:
        root, ratio, _ = roots[name]
        g[joint.idx_v, left.index(root)] = ratio
    rng, rows, apart = np.random.default_rng(int(seed)), {"q": [], "rate": [], "acceleration": []}, 0.0
    data = whole.createData()
    for _ in range(int(states)):
        q, v = rng.uniform(-1.0, 1.0, len(left)), rng.normal(size=len(left))
        places = {name: ratio * q[left.index(root)] + offset for name, (root, ratio, offset) in roots.items()}
        rates = g @ v
        effort = -np.asarray(whole.damping) * rates - np.asarray(whole.friction) * np.tanh(rates / TURNING)
        mass, bias, _ = solved(whole, data, configuration(whole, places), rates, effort)
        acceleration = np.linalg.solve(g.T @ mass @ g, g.T @ (effort - bias))
        if model is not None:
            own = [n for joint, n in zip(model.joints, model.names, strict=True) if joint.nv and n in left]
            order = [left.index(name) for name in own]
            at, moved = configuration(model, places), (g.T @ effort)[order]
            found = np.zeros(len(left))
            found[order] = solved(model, model.createData(), at, v[order], moved)[2]
            apart = max(apart, np.abs(found - acceleration).max() / np.abs(acceleration).max())
            acceleration = found
        for key, value in {"q": q, "rate": v, "acceleration": acceleration}.items():
            rows[key].append(value)
    rows = {key: np.array(value) for key, value in rows.items()}
    by = "elimination" if model is None else "mimic=True"
    said = {"path": path, "version": pin.__version__, "by": by, "apart": apart}
    np.savez(out, **said, names=np.array(left), frames=np.array([]), followers=len(moving) - len(left), **rows)


if __name__ == "__main__":
    main(*sys.argv[1:])
