"""The dynamics of a large mechanism by loops: over its links for the frames, over its columns for inertia and loads
(`recursion`).

Moments are about the centre of mass of the whole.
"""

from collections.abc import Sequence
from typing import ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.forms.frames import Extra, Frames, Moves, Pair, SpatialForce, rotors
from clearance_jax.dynamics.forms.link_motion import add_up, given_motion, multiply_each, sweep
from clearance_jax.dynamics.forms.recursion import Tree, factor_tree
from clearance_jax.mechanism.body import GROUND
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import State
from clearance_jax.mechanism.tree.frame import Frame
from clearance_jax.mechanism.tree.links import Masks, Order, links_of, masks, order
from clearance_jax.spatial import IDENTITY, ZERO, Term, Vector, as_array, three


class ColumnArrays(NamedTuple):
    """The free columns for one body: `spins` and `slides` (columns, 3), the spin and the velocity that each gives to
    what it moves, the velocity at the `origin`; `moves`: 1 if it moves the body, else 0.
    """

    spins: Float[Array, "columns 3"]
    slides: Float[Array, "columns 3"]
    origin: Float[Array, "3"]
    moves: np.ndarray

    def velocity_at(self, point: Vector) -> Float[Array, "columns 3"]:
        """Velocity of a body's point by each column."""
        arm = as_array(point) - self.origin
        return jnp.asarray(self.moves)[:, None] * (self.slides + jnp.cross(self.spins, arm[None]))

    @property
    def spin(self) -> Float[Array, "columns 3"]:
        """Spin of a body by each column."""
        return jnp.asarray(self.moves)[:, None] * self.spins


def columns_in_tree(plan: Order, masks: Masks, free: int) -> tuple[Tree, dict[int, int]]:
    """The columns in the order of the tree, and the last one of every link (-1, the ground: the row behind all)."""
    places = sorted(range(len(masks.links)), key=lambda column: masks.links[column])
    links = [masks.links[column] for column in places]
    last = {-1: len(places)} | {link: k for k, link in enumerate(links)}
    firsts = [k == 0 or links[k - 1] != link for k, link in enumerate(links)]
    parents = [
        last[plan.parents[link]] if first else k - 1 for k, (link, first) in enumerate(zip(links, firsts, strict=True))
    ]
    return Tree(tuple(parents), tuple(places), free), last


# Term by term: XLA gives products of large arrays to a library, whose call ends a compiled loop.


def apply_each(matrices: Float[Array, "n i k"], vectors: Float[Array, "n k"]) -> Float[Array, "n i"]:
    """The products of matrices with vectors."""
    return add_up(matrices[:, :, k] * vectors[:, k, None] for k in range(vectors.shape[1]))


class TabledFrames(Frames):
    """Frames and dynamics of a large mechanism."""

    is_solved_implicitly: ClassVar[bool] = False

    def __init__(self, mechanism: PreparedMechanism, time: Scalar, state: State, accelerations: Sequence[Term]):
        self.mechanism = mechanism
        self.plan: Order = order(mechanism.joints)
        self.masks: Masks = masks(self.plan)
        links = mechanism.links or links_of(mechanism.bodies, mechanism.joints)
        self.links = links
        given = given_motion(mechanism, self.plan, time, state, accelerations)
        self.rates, local, self.motions = sweep(self.plan, links, given)
        self._frames: dict[str, tuple[Frame, ColumnArrays]] = {}
        carriers = np.array([self.plan.carriers[body.name] for body in mechanism.bodies])
        # The carrier of a body fixed to the ground is the ground, behind all links.
        self.carriers = np.where(carriers < 0, len(self.plan.coordinates), carriers)
        m = self.motions
        self.turned = m.rotation[self.carriers]
        arms = apply_each(self.turned, links.centre)
        spin, spin_rate = m.spin[self.carriers], m.spin_rate[self.carriers]
        self.spin, self.spin_rate = spin, spin_rate
        self.centres = m.place[self.carriers] + arms
        self.speeds = m.velocity[self.carriers] + jnp.cross(spin, arms)
        swing = jnp.cross(spin_rate, arms) + jnp.cross(spin, jnp.cross(spin, arms))
        self.accelerations = m.acceleration[self.carriers] + swing
        self.inertias = multiply_each(multiply_each(self.turned, links.inertia), jnp.swapaxes(self.turned, 1, 2))
        whole = jnp.sum(links.mass)
        self.origin = links.mass @ self.centres / jnp.where(whole > 0, whole, 1.0)
        where = np.array(self.masks.links)
        axes = apply_each(m.rotation[where], local[where] + self.masks.local)
        turns = self.masks.turns[:, None]
        self.column_spins = turns * axes
        self.column_slides = turns * jnp.cross(axes, self.origin[None] - m.place[where]) + (1 - turns) * axes
        self.count = len(where) - sum(not c.motion.is_free for c in self.plan.coordinates)
        self.tree, last = columns_in_tree(self.plan, self.masks, self.count)
        # By body, the column in the order of the tree that carries it.
        self.holders = [last[self.plan.carriers[body.name]] for body in mechanism.bodies]
        self.axes = self.tree.in_tree(jnp.concatenate([self.column_spins, self.column_slides], 1))

    # Frames and what moves them -------------------------------------------------------------------------------------

    def __getitem__(self, body):
        return self._at(body)[0]

    def columns(self, body: str) -> ColumnArrays:
        """The free columns, with marks of those that move a body."""
        return self._at(body)[1]

    def velocities(self, body, point, base=None, beside=ZERO):
        moves = self.columns(body).velocity_at(point)
        return Moves(moves if base is None else moves - self.columns(base).velocity_at(beside))

    def spins(self, body, base=None):
        spin = self.columns(body).spin
        return Moves(spin if base is None else spin - self.columns(base).spin)

    def extra(self, acceleration):
        return Extra(
            lambda body, point: three(as_array(acceleration) @ self.columns(body).velocity_at(point)),
            lambda body: three(as_array(acceleration) @ self.columns(body).spin),
        )

    def _at(self, body: str) -> tuple[Frame, ColumnArrays]:
        if body not in self._frames:
            moves = self._movers(self.plan.carriers[body])
            n = self.count
            free = ColumnArrays(self.column_spins[:n], self.column_slides[:n], self.origin, moves[:n])
            self._frames[body] = self._frame(body), free
        return self._frames[body]

    def _frame(self, body: str) -> Frame:
        if body == GROUND:
            return Frame()
        m, i = self.motions, [other.name for other in self.mechanism.bodies].index(body)
        link = int(self.carriers[i])
        turned = m.rotation[link] @ self.links.body_turned[i]
        arm = m.rotation[link] @ self.links.body_offset[i]
        spin, spin_rate = m.spin[link], m.spin_rate[link]
        swing = jnp.cross(spin, arm)
        return Frame(
            rotation=IDENTITY.compose((three(turned[0]), three(turned[1]), three(turned[2]))),
            position=three(m.place[link] + arm),
            spin=three(spin),
            velocity=three(m.velocity[link] + swing),
            spin_rate=three(spin_rate),
            acceleration=three(m.acceleration[link] + jnp.cross(spin_rate, arm) + jnp.cross(spin, swing)),
            pivot=three(self.pivots()[i]),
        )

    def pivots(self) -> Float[Array, "bodies 3"]:
        """By body the place of the joint that carries it, be it fixed on the link of another one."""
        return self.motions.place[self.carriers] + apply_each(self.turned, self.links.pivot)

    def _movers(self, link: int) -> np.ndarray:
        """Which columns move a link."""
        return self.masks.beyond[:, link] if link >= 0 else np.zeros(len(self.masks.links))

    # Inertia and loads ----------------------------------------------------------------------------------------------

    def mass_matrix(self, firm=None):
        turning, inertias = rotors(self.mechanism), self.inertias_of_columns()
        added = as_array([turning.get(i, 0.0) for i in range(self.tree.count)])
        if firm:
            whole = self.tree.inward(inertias)[:-1]
            diagonal = added + self.tree.of_mechanism(jnp.sum(self.axes * apply_each(whole, self.axes), 1))
            added = added + diagonal * as_array([firm.get(i, 1.0) - 1.0 for i in range(self.tree.count)])
        return factor_tree(self.tree, self.axes, inertias, self.tree.in_tree(added))

    def inertias_of_columns(self) -> Float[Array, "rows 6 6"]:
        """By column in the order of the tree, the inertia of the bodies that it carries itself, about the origin."""
        mass, arms = self.links.mass, self.centres - self.origin[None]
        moments, unit = mass[:, None] * arms, jnp.eye(3)
        square = jnp.sum(moments * arms, 1)
        about = self.inertias + square[:, None, None] * unit[None] - moments[:, :, None] * arms[:, None, :]
        # hat @ v is moments x v.
        hat = jnp.cross(moments[:, None, :], unit[None]).swapaxes(1, 2)
        upper = jnp.concatenate([about, hat], 2)
        lower = jnp.concatenate([-hat, mass[:, None, None] * unit[None]], 2)
        return self.by_holder(jnp.concatenate([upper, lower], 1), self.holders)

    def by_holder(self, values: Array, holders: Sequence[int]) -> Array:
        """By column in the order of the tree (the ground's row behind): the sum of the values that it carries."""
        rows = [[i for i, holder in enumerate(holders) if holder == k] for k in range(self.tree.count + 1)]
        most, none = max(map(len, rows)), len(holders)
        filled = np.array([row + [none] * (most - len(row)) for row in rows])
        padded = jnp.concatenate([values, jnp.zeros((1, *values.shape[1:]))])
        return add_up(padded[places] for places in filled.T)

    def deficits(self, acceleration: list[Term] | None = None) -> tuple[Array, Array]:
        """Weight minus inertia forces of the bodies and their moments about the origin, (bodies, 3) each."""
        at, spin_rate = self.accelerations, self.spin_rate
        if acceleration is not None:
            more, more_spin = self.add_accelerations(as_array(acceleration))
            at, spin_rate = at + more, spin_rate + more_spin
        force = self.links.mass[:, None] * (as_array(self.mechanism.gravity.vector)[None] - at)
        momentum = apply_each(self.inertias, self.spin)
        turning = apply_each(self.inertias, spin_rate) + jnp.cross(self.spin, momentum)
        return force, jnp.cross(self.centres - self.origin[None], force) - turning

    def add_accelerations(self, acceleration: Array) -> tuple[Array, Array]:
        """What free accelerations add to accelerations of the centres of mass and to spin rates, (bodies, 3)."""
        driven = jnp.zeros(self.tree.count - self.count)
        rates = self.tree.in_tree(jnp.concatenate([acceleration, driven]))
        moved = self.tree.outward(self.axes * rates[:, None])[np.array(self.holders)]
        spin, slide = moved[:, :3], moved[:, 3:]
        return slide + jnp.cross(spin, self.centres - self.origin[None]), spin

    def wrenches(self, acceleration):
        force, moment = self.deficits(acceleration)
        children = [joint.child for joint in self.mechanism.joints]
        bodies = [body.name for body in self.mechanism.bodies]
        hanging = np.array([[float(name in self.mechanism.beyond(child)) for name in bodies] for child in children])
        pivots = self.pivots()[np.array([bodies.index(child) for child in children])]
        forces, moments = (jnp.sum(hanging[:, :, None] * part[None], 1) for part in (force, moment))
        moments = moments + jnp.cross(self.origin[None] - pivots, forces)
        return {child: SpatialForce(three(forces[k]), three(moments[k])) for k, child in enumerate(children)}

    def load_without_rotors(self, pairs, acceleration):
        load = self.project(pairs, acceleration)
        return [load[i] for i in range(self.count)]

    def drive_forces(self, pairs, acceleration):
        exerted, links = -self.project(pairs, acceleration), self.masks.links
        return [(exerted[i], self.rates[links[i]]) for i in range(self.count, len(links))]

    def project(self, pairs: list[Pair], acceleration: list[Term] | None) -> Array:
        """The bodies' wrenches and those of pairs projected on the columns, free ones first."""
        force, moment = self.deficits(acceleration)
        holders = {GROUND: self.tree.count}
        holders |= {body.name: holder for body, holder in zip(self.mechanism.bodies, self.holders, strict=True)}
        on, wrenches = list(self.holders), [jnp.concatenate([moment, force], 1)]
        if pairs:
            push = jnp.stack([as_array(pair.force) for pair in pairs])
            arms = jnp.stack([as_array(pair.at) for pair in pairs]) - self.origin[None]
            turning = jnp.stack([as_array(pair.torque) for pair in pairs]) + jnp.cross(arms, push)
            pushed = jnp.concatenate([turning, push], 1)
            on += [holders[pair.child] for pair in pairs] + [holders[pair.parent] for pair in pairs]
            wrenches += [pushed, -pushed]
        whole = self.tree.inward(self.by_holder(jnp.concatenate(wrenches), on))[:-1]
        return self.tree.of_mechanism(jnp.sum(self.axes * whole, axis=1))

    # Energies -------------------------------------------------------------------------------------------------------

    def energies(self):
        sliding = self.links.mass @ jnp.sum(self.speeds**2, axis=1)
        kinetic = 0.5 * (sliding + jnp.sum(self.spin * apply_each(self.inertias, self.spin)))
        return kinetic, -self.links.mass @ (self.centres @ as_array(self.mechanism.gravity.vector))

    def kinetic_exchange(self, acceleration):
        at, spin_rate = self.add_accelerations(as_array(acceleration))
        at, spin_rate = self.accelerations + at, self.spin_rate + spin_rate
        turning = apply_each(self.inertias, spin_rate)
        sliding = self.links.mass @ jnp.sum(jnp.abs(self.speeds * at), axis=1)
        return sliding + jnp.sum(jnp.abs(self.spin * turning))
