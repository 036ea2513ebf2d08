"""The dynamics of a large mechanism as products of arrays: a loop over its links says where everything is; composite
bodies are sums by masks that say which column moves which body.

It answers as the frames of a small mechanism do (`kinematics.frames`), for whom asks for one body or point; moments are
taken about the centre of mass of the whole.
"""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._numerics import sincos
from clearance_jax._types import Scalar
from clearance_jax.mechanism.body import GROUND
from clearance_jax.mechanism.frame import Column, Frame
from clearance_jax.mechanism.links import Links, Masks, Order, links_of, masks, order, rodrigues
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.state import State, parts
from clearance_jax.spatial import IDENTITY, Term, Vector, as_array, of_quaternion


class Columns(NamedTuple):
    """The free columns of a table, as one: `spins` and velocities at the `origin` of what each moves, (columns, 3);
    `moves`: which of them move a body, as zeros and ones.
    """

    spins: Float[Array, "columns 3"]
    slides: Float[Array, "columns 3"]
    origin: Float[Array, "3"]
    moves: np.ndarray

    def velocity_at(self, point: Vector) -> Float[Array, "columns 3"]:
        """Velocity of a body's point by each of them."""
        arm = as_array(point) - self.origin
        return jnp.asarray(self.moves)[:, None] * (self.slides + jnp.cross(self.spins, arm[None]))

    @property
    def spin(self) -> Float[Array, "columns 3"]:
        """Spin of a body by each of them."""
        return jnp.asarray(self.moves)[:, None] * self.spins


class Motions(NamedTuple):
    """Of every link: rotation, place, spin, velocity, and their rates without the free accelerations."""

    rotation: Array
    place: Array
    spin: Array
    velocity: Array
    spin_rate: Array
    acceleration: Array


class Table(Mapping):
    """Where everything of a large mechanism is and how it moves: a mapping of names to frames, as for a small one."""

    def __init__(self, mechanism: Mechanism, time: Scalar, state: State):
        self.mechanism = mechanism
        self.plan: Order = order(mechanism.joints)
        self.masks: Masks = masks(self.plan, mechanism.bodies)
        links = mechanism.links or links_of(mechanism.bodies, mechanism.joints)
        self.links = links
        self.rates, self.motions = sweep(mechanism, self.plan, links, time, state)
        self._frames: dict[str, Frame] = {}
        carriers = np.array([self.plan.carriers[body.name] for body in mechanism.bodies])
        # Of what is fixed to the ground nothing moves: its carrier is the ground, behind all links.
        self.carriers = np.where(carriers < 0, len(self.plan.coordinates), carriers)
        m = self.motions
        self.turned = m.rotation[self.carriers]
        arms = jnp.einsum("bij,bj->bi", self.turned, links.centre)
        spin, spin_rate = m.spin[self.carriers], m.spin_rate[self.carriers]
        self.spin, self.spin_rate = spin, spin_rate
        self.centres = m.place[self.carriers] + arms
        self.velocities = m.velocity[self.carriers] + jnp.cross(spin, arms)
        swing = jnp.cross(spin_rate, arms) + jnp.cross(spin, jnp.cross(spin, arms))
        self.accelerations = m.acceleration[self.carriers] + swing
        self.inertias = self.turned @ links.inertia @ jnp.swapaxes(self.turned, 1, 2)
        whole = jnp.sum(links.mass)
        self.origin = links.mass @ self.centres / jnp.where(whole > 0, whole, 1.0)
        where = np.array(self.masks.links)
        local = links.axis[where] + self.masks.local
        axes = jnp.einsum("cij,cj->ci", m.rotation[where], local)
        turns = self.masks.turns[:, None]
        self.spins = turns * axes
        self.slides = turns * jnp.cross(axes, self.origin[None] - m.place[where]) + (1 - turns) * axes
        self.count = len(where) - sum(not c.motion.is_free for c in self.plan.coordinates)

    # As a mapping ---------------------------------------------------------------------------------------------------

    def __iter__(self):
        return iter(self.plan.carriers)

    def __len__(self) -> int:
        return len(self.plan.carriers)

    def __getitem__(self, name: str) -> Frame:
        """The frame of a body."""
        if name not in self._frames:
            self._frames[name] = self._frame(name)
        return self._frames[name]

    def _frame(self, name: str) -> Frame:
        moves = self._moved_by(self.plan.carriers[name])
        free = Columns(self.spins[: self.count], self.slides[: self.count], self.origin, moves[: self.count])
        if name == GROUND:
            return Frame(free=free)
        m, i = self.motions, [body.name for body in self.mechanism.bodies].index(name)
        link = int(self.carriers[i])
        turned = m.rotation[link] @ self.links.body_turned[i]
        arm = m.rotation[link] @ self.links.body_offset[i]
        spin, spin_rate = m.spin[link], m.spin_rate[link]
        swing = jnp.cross(spin, arm)
        return Frame(
            rotation=IDENTITY.followed((three(turned[0]), three(turned[1]), three(turned[2]))),
            position=three(m.place[link] + arm),
            spin=three(spin),
            velocity=three(m.velocity[link] + swing),
            spin_rate=three(spin_rate),
            acceleration=three(m.acceleration[link] + jnp.cross(spin_rate, arm) + jnp.cross(spin, swing)),
            pivot=three(m.place[link]),
            free=free,
            prescribed=tuple(self._prescribed(int(k)) for k in np.flatnonzero(moves[self.count :]) + self.count),
        )

    def _moved_by(self, link: int) -> np.ndarray:
        """Which columns move a link."""
        return self.masks.beyond[:, link] if link >= 0 else np.zeros(len(self.masks.links))

    def _prescribed(self, column: int) -> tuple[Column, Term]:
        link = self.masks.links[column]
        axis = three(self.spins[column] if self.masks.turns[column] else self.slides[column])
        pivot = three(self.motions.place[link]) if self.masks.turns[column] else None
        return Column(-1, axis, pivot), self.rates[link]

    # Inertia and loads ----------------------------------------------------------------------------------------------

    def mass_matrix(self) -> Array:
        """Of the free velocities, whole."""
        n, carried = self.count, jnp.asarray(self.masks.bodies[: self.count])
        spins, slides = self.spins[:n], self.slides[:n]
        mass, arms = self.links.mass, self.centres - self.origin[None]
        moments = mass[:, None] * arms
        square = jnp.einsum("bi,bi->b", moments, arms)
        inertia = self.inertias + square[:, None, None] * jnp.eye(3)[None] - moments[:, :, None] * arms[:, None, :]
        masses = carried @ mass
        first = carried @ moments
        second = jnp.einsum("cb,bij->cij", carried, inertia)
        force = masses[:, None] * slides + jnp.cross(spins, first)
        moment = jnp.einsum("cij,cj->ci", second, spins) + jnp.cross(first, slides)
        lower = jnp.asarray(self.masks.columns[:n, :n]) * (force @ slides.T + moment @ spins.T)
        # Of two columns the further one's momentum counts; both of a ball move the same.
        both = self.masks.columns[:n, :n] * self.masks.columns[:n, :n].T
        return lower + jnp.where(both > 0, 0.0, lower.T)

    def wrenches(self, acceleration: Array | None = None) -> tuple[Array, Array]:
        """Weight minus inertia forces of every body, and their moments about the origin, (bodies, 3) each; with the
        free accelerations where they are given.
        """
        at, spin_rate = self.accelerations, self.spin_rate
        if acceleration is not None:
            more, more_spin = self.extra(acceleration)
            at, spin_rate = at + more, spin_rate + more_spin
        force = self.links.mass[:, None] * (as_array(self.mechanism.gravity.vector)[None] - at)
        momentum = jnp.einsum("bij,bj->bi", self.inertias, self.spin)
        turning = jnp.einsum("bij,bj->bi", self.inertias, spin_rate) + jnp.cross(self.spin, momentum)
        return force, jnp.cross(self.centres - self.origin[None], force) - turning

    def extra(self, acceleration: Array) -> tuple[Array, Array]:
        """What free accelerations add to the accelerations of the centres of mass, and to the spin rates, of bodies."""
        n, carried = self.count, jnp.asarray(self.masks.bodies[: self.count])
        spin = jnp.einsum("cb,ci->bi", carried * acceleration[:, None], self.spins[:n])
        slide = jnp.einsum("cb,ci->bi", carried * acceleration[:, None], self.slides[:n])
        return slide + jnp.cross(spin, self.centres - self.origin[None]), spin

    def load(self, acceleration: Array | None = None) -> Array:
        """Weight and inertia forces by free velocity; with the free accelerations where they are given."""
        return self.projected(*self.wrenches(acceleration))[: self.count]

    def projected(self, force: Array, moment: Array) -> Array:
        """The bodies' wrenches by column, free ones first."""
        carried = self.masks.bodies
        return jnp.sum(self.slides * (carried @ force) + self.spins * (carried @ moment), axis=1)

    def pair(self, parent: str, child: str, force: Vector, torque: Vector, at: Vector) -> Array:
        """A wrench pair by column."""
        links = (self.plan.carriers[name] for name in (child, parent))
        moves = np.subtract(*(self._moved_by(link) for link in links))
        push, arm = as_array(force), as_array(at) - self.origin
        turning = as_array(torque) + jnp.cross(arm, push)
        return jnp.asarray(moves) * (self.slides @ push + self.spins @ turning)

    # Energies -------------------------------------------------------------------------------------------------------

    def kinetic(self) -> Array:
        """Kinetic energy [J]."""
        sliding = self.links.mass @ jnp.sum(self.velocities**2, axis=1)
        return 0.5 * (sliding + jnp.einsum("bi,bij,bj->", self.spin, self.inertias, self.spin))

    def potential(self) -> Array:
        """Potential energy of weight [J]."""
        return -self.links.mass @ (self.centres @ as_array(self.mechanism.gravity.vector))

    def kinetic_exchange(self, acceleration: Array) -> Array:
        """Rate at which kinetic energy is exchanged between bodies and axes [W]."""
        at, spin_rate = self.extra(acceleration)
        at, spin_rate = self.accelerations + at, self.spin_rate + spin_rate
        turning = jnp.einsum("bij,bj->bi", self.inertias, spin_rate)
        sliding = self.links.mass @ jnp.sum(jnp.abs(self.velocities * at), axis=1)
        return sliding + jnp.sum(jnp.abs(self.spin * turning))

    def hanging_on(self, body: str) -> np.ndarray:
        """Which bodies hang on a body, itself among them, as zeros and ones."""
        beyond = self.mechanism.beyond(body)
        return np.array([float(other.name in beyond) for other in self.mechanism.bodies])


def three(a: Array) -> Vector:
    """An array of three as a vector."""
    return a[0], a[1], a[2]


class Given(NamedTuple):
    """Of every link's coordinate its value, rate and prescribed acceleration; of balls instead (zeros there) the matrix
    by its link, and of every link the spin of a ball in its own axes.
    """

    values: list[Term]
    rates: list[Term]
    accelerations: list[Term]
    turned: dict[int, Array]
    spins: list[Array]


def given_motion(mechanism: Mechanism, plan: Order, time: Scalar, state: State) -> Given:
    """What drives and the state say of the links' coordinates."""
    own = {part.coordinate.name: part for part in parts(mechanism)}
    out = Given([], [], [], {}, [])
    for i, c in enumerate(plan.coordinates):
        part, spin = own.get(c.name), jnp.zeros(3)
        if part is None:
            assert c.motion.drive is not None
            q, v, a = c.motion.drive(time)
        elif c.is_ball:
            w, x, y, z = state.q[part.q]
            out.turned[i] = jnp.stack([as_array(row) for row in of_quaternion(w, x, y, z)])
            spin = as_array(state.v[part.v])
            q = v = a = 0.0
        else:
            q, v, a = state.q[part.q.start], state.v[part.v.start], 0.0
        for values, value in zip((out.values, out.rates, out.accelerations, out.spins), (q, v, a, spin), strict=True):
            values.append(value)
    return out


def sweep(mechanism: Mechanism, plan: Order, links: Links, time: Scalar, state: State) -> tuple[list[Term], Motions]:
    """Rates of the links' coordinates (of a ball zero), and the motion of every link and, behind them, of the
    ground.
    """
    count, now = len(plan.coordinates), given_motion(mechanism, plan, time, state)
    turning = np.array([float(c.turns is not None) for c in plan.coordinates])
    sliding = np.array([float(c.slides is not None) for c in plan.coordinates])
    q, v, a = as_array(now.values), as_array(now.rates), as_array(now.accelerations)
    sine, cosine = sincos(turning * q)
    inner = rodrigues(links.axis, sine, cosine)
    for i, rows in now.turned.items():
        inner = inner.at[i].set(rows)
    given = (
        np.array([parent if parent >= 0 else count for parent in plan.parents]),
        np.arange(count),
        links.turned @ inner,
        links.offset,
        (sliding * q)[:, None] * links.axis,
        (sliding * v)[:, None] * links.axis,
        (sliding * a)[:, None] * links.axis,
        (turning * v)[:, None] * links.axis + jnp.stack(now.spins),
        (turning * a)[:, None] * links.axis,
    )
    still = jnp.zeros((count + 1, 3))
    begin = Motions(jnp.broadcast_to(jnp.eye(3), (count + 1, 3, 3)), *[still] * 5)

    def once(motions: Motions, link):
        parent, i, rows, offset, slid, slides, sped, spun, spun_up = link
        at = jax.tree.map(lambda x: x[parent], motions)
        rotation = at.rotation @ rows
        slide, step = rotation @ slides, rotation @ slid
        arm = at.rotation @ offset + step
        spin = rotation @ spun
        new = Motions(
            rotation,
            at.place + arm,
            at.spin + spin,
            at.velocity + jnp.cross(at.spin, arm) + slide,
            at.spin_rate + jnp.cross(at.spin, spin) + rotation @ spun_up,
            at.acceleration
            + jnp.cross(at.spin_rate, arm)
            + jnp.cross(at.spin, jnp.cross(at.spin, arm) + 2 * slide)
            + rotation @ sped,
        )
        return jax.tree.map(lambda x, y: jax.lax.dynamic_update_index_in_dim(x, y, i, 0), motions, new), None

    return now.rates, jax.lax.scan(once, begin, given)[0]
