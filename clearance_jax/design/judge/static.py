"""Static bounds of the error of a point: how far play alone can move it in a mechanism at rest."""

import itertools
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from clearance_jax.analysis.pose_errors import place_slopes, play_of
from clearance_jax.dynamics.closures import mobility
from clearance_jax.errors import ClearanceError
from clearance_jax.joints import AbstractClearance, AbstractPin, PlayCoordinate
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.metrics.ideal import freedom

AXIAL = ".axial_clearance"
# Iterations towards the largest reach, which grows with each.
CLIMB = 60


def static_weights(
    mechanism: Mechanism,
    point: str,
    t1: float,
    samples: int = 181,
    t0: float = 0.0,
    joints: Sequence[str] | None = None,
) -> dict[str, float]:
    """How far a named point of the ideal mechanism moves at most over time, per clearance of each joint. The sum of
    weight times clearance bounds what play alone can do to a mechanism at rest. Deformation and impacts can do more.

    For a joint without tilt the weight is the largest singular value of the derivative of the point's place by the
    pin's offset; for a joint without clearance, by an offset along any axis of the mechanism (two in the plane, three
    in space). For a pin that tilts, both ends of its axis may be anywhere within the radial clearance: the weight is 1
    at a distance l <= L / 2 from the middle of a sleeve of length L, along its axis, and 2 l / L beyond. (Faces may
    stop the tilt before.) Its axial clearance has a weight of its own, called `JOINT.axial_clearance`. For a block in a
    guide, each end may be at any of its walls, at two at once in a corner.

    **Arguments:** `mechanism`; `point`: its name; `t0`, `t1`: start and end of the motion [s]; `samples`: at how many
    times the weights are computed; `joints`: names of joints of any kind, with clearance or without, by default those
    with clearance.

    **Returns:** the weights by name.

    **Raises:** `ClearanceError` for an unknown point or joint, if there is no joint to ask for, and for an ideal
    mechanism that moves freely (its pose depends on forces) or is over-constrained (an offset strains it).
    """
    ideal = mechanism.intended()
    if freedom(ideal) > 0:
        raise ClearanceError("An ideal mechanism that moves freely has no static bound: drive its joints.")
    if ideal.may_repeat and (repeated := mobility(ideal, t0).repeated):
        raise ClearanceError(
            f"An over-constrained mechanism has no static bound: {repeated} of the conditions of its loops only repeat "
            "others, so that an offset in one joint strains it. Close its loops by joints of more freedom (`Spherical` "
            "instead of `Revolute`, say)."
        ).about("loops", repeated)
    if any(gap.what == "teeth" for gap in mechanism.gaps):
        text = "A static bound is not known of gears whose teeth load their bearings."
        raise ClearanceError(f"{text} Leave out `module` or `base_radius`.").about("base_radius")
    known = [p.name for p in mechanism.points]
    if point not in known:
        raise ClearanceError(f"There is no point `{point}`. Allowed: {', '.join(known)}.").about(point, allowed=known)
    names = loose_names(mechanism) if joints is None else tuple(joints)
    if not names:
        text = "No joint has clearance here: name the joints that are to be asked for, `joints=`."
        raise ClearanceError(text).about("joints")
    # The clearance of each joint, of those that have one.
    gaps = {gap.name for gap in mechanism.gaps}
    made = [None if name in gaps else getattr(mechanism.joint(name), "clearance", None) for name in names]
    slopes = place_slopes(mechanism, known.index(point), names, jnp.asarray(t0, float), jnp.asarray(t1, float), samples)
    weights: dict[str, float] = {}
    for name, clearance, slope in zip(names, made, slopes, strict=True):
        flat = isinstance(clearance, AbstractClearance) and clearance.flat
        reaches = _reaches(play_of(mechanism, name), np.asarray(slope), flat)
        weights |= {name + ending: float(np.max(reach)) for ending, reach in reaches.items()}
    return weights


def loose_names(mechanism: Mechanism) -> tuple[str, ...]:
    """The names of everything with play: joints with clearance, then drives and couplings with backlash."""
    return (*(j.name for j in mechanism.clearance_joints()), *(gap.name for gap in mechanism.gaps if gap.is_play))


def static_error(mechanism: Mechanism, weights: dict[str, float]) -> float:
    """The sum of weights of joints with clearance times their clearances [m], of a worn sleeve where it is deepest."""
    total = 0.0
    for name, weight in weights.items():
        joint = name.removesuffix(AXIAL)
        play = play_of(mechanism, joint)
        if name.endswith(AXIAL):
            size = float(next(c.scale for c in play if c.suffix == ".play_z"))
        else:
            size, gaps = float(play[0].scale), {gap.name for gap in mechanism.gaps}
            clearance = None if joint in gaps else getattr(mechanism.joint(joint), "clearance", None)
            if isinstance(clearance, AbstractPin) and clearance.depth is not None:
                size += float(clearance.profile.max())
        total += weight * size
    return total


def _reaches(play: Sequence[PlayCoordinate], slope: np.ndarray, flat: bool) -> dict[str, np.ndarray]:
    """How far the point moves per clearance (times,), by the suffix of the clearance's name. `slope` (times, axes,
    play); `flat`: whether walls bound each slide across separately.

    Both ends of a pin that tilts move by up to one clearance. Half the sum of their offsets moves the middle, half of
    their difference leans the axis. So one end moves the point by middle + lean, the other by middle - lean.
    """
    turns = {k: np.asarray(c.turns, float) for k, c in enumerate(play) if c.turns is not None}
    if not turns:
        return {"": np.linalg.norm(slope, ord=2, axis=(1, 2))}
    slides = {k: np.asarray(c.slides, float) for k, c in enumerate(play) if c.slides is not None}
    across = [k for k, axis in slides.items() if axis[2] == 0]
    tilts, radial = [k for k, axis in turns.items() if axis[2] == 0], play[across[0]].scale
    # A tilt leans the axis (z) along a slide by this share.
    leans = [sum(slope[..., t] * (np.cross(turns[t], [0, 0, 1]) @ slides[k]) for t in tilts) for k in across]
    middle, lean = slope[..., across] / 2, np.stack(leans, axis=-1) * float(play[tilts[0]].scale / radial) / 2
    out = (_corners if flat else _both_ends)(middle + lean, middle - lean)
    for k in turns.keys() - set(tilts):
        out = out + np.linalg.norm(slope[..., k], axis=1) * float(play[k].scale / radial)
    axial = [k for k in slides if k not in across]
    return {"": out} | ({AXIAL: np.linalg.norm(slope[..., axial], ord=2, axis=(1, 2))} if axial else {})


def _both_ends(first: np.ndarray, other: np.ndarray) -> np.ndarray:
    """The largest norm (times,) of P e + Q f over unit vectors e and f, for matrices P and Q (times, axes, k). It is
    the maximum of |P^T n| + |Q^T n| over directions n, found by ascent from several directions.
    """
    starts = [np.linalg.svd(part)[0][..., 0] for part in (first, other, first + other, first - other)]
    best = size = np.zeros(len(first))
    for direction in starts:
        for _ in range(CLIMB):
            ends = [np.einsum("tij,ti->tj", part, direction) for part in (first, other)]
            units = [e / np.maximum(np.linalg.norm(e, axis=1), 1e-300)[:, None] for e in ends]
            reached = sum(np.einsum("tij,tj->ti", part, e) for part, e in zip((first, other), units, strict=True))
            size = np.linalg.norm(reached, axis=1)
            direction = reached / np.maximum(size, 1e-300)[:, None]
        best = np.maximum(best, size)
    return best


def _corners(first: np.ndarray, other: np.ndarray) -> np.ndarray:
    """As `_both_ends`, but over vectors e and f whose components lie between -1 and 1. The norm is convex, so its
    maximum is at a corner of this box.
    """
    both = np.concatenate([first, other], axis=-1)
    signs = np.array(list(itertools.product((1.0, -1.0), repeat=both.shape[-1])))
    return np.linalg.norm(both @ signs.T, axis=1).max(axis=-1)
