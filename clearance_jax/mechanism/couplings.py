"""Couplings: linear relations of joint coordinates, which gears, racks, screws, belts and differentials make.

A coordinate follows one or two others: q = ratio * q_leader + second_ratio * q_second + offset. It is no state: place,
velocity and acceleration follow exactly, so nothing drifts. Its inertia, and the forces on it, act on its leaders
through the ratio. (With backlash it moves by itself, and contacts keep it within a gap: `mechanism.gaps`.) Angles are
those of the joints, so each is relative to the body that carries the joint: on a carrier that turns, the relation of
the wheels is that in the carrier's axes (Willis).
"""

import dataclasses
import math
from collections.abc import Collection, Iterator, Mapping, Sequence

import equinox as eqx

from clearance_jax._basis.types import Scalar
from clearance_jax.errors import ClearanceError, unknown_name, wrong_value
from clearance_jax.laws import AbstractFrictionLaw, AbstractNormalLaw
from clearance_jax.parameters import Demand, Parametrised, describe, flatten, physical

# Of a preset: also a plain one.
Number = float | int | Scalar
# A wheel with fewer teeth cannot mesh.
LEAST_TEETH = 5


class Coupling(Parametrised):
    """A coordinate that follows others: q_follower = ratio * q_leader + second_ratio * q_second + offset.

    `Gear`, `Rack`, `Screw`, `Belt`, `Differential` and `Planetary` make couplings from what a drawing says.

    **Arguments:**

    - `name`: of the coupling. `NAME.torque` is what it exerts on the follower [N m], of a slide [N].
    - `follower`, `leader`, `second`: names of coordinates of the tree. The follower has no drive. It may lead others.
    - `ratio`, `second_ratio`: rates of the follower by those of its leaders, in [1], [m/rad] or [rad/m].
    - `offset` [rad or m]: the follower's value where its leaders are zero.
    - `backlash` [rad or m of the follower]: the whole gap between the teeth, with the law of their `flank` (a
      `laws.Flank`, or another normal law, whose forces are then efforts on the follower). The follower is then a
      coordinate of its own, which starts in the middle of the gap; its `position` and `velocity` count from there.
    - `base_radius` [m] of the follower, in a pair of external gears in the plane. Their teeth then push along the lines
      of action, the flanks' law is one of forces [N] and lengths [m], and both bearings bear the force. Play of the
      bearings changes the backlash. Both wheels are on pins of one body.
    - `friction`: the law of such teeth, with `sliding` [m]: the mean distance of their points of contact from the pitch
      point, by which they slide as both wheels turn against each other.

    **Raises:** `ClearanceError`, from the mechanism, for unknown coordinates, play, balls, a follower that a drive
    prescribes, and circles.
    """

    name: str = eqx.field(static=True)
    follower: str = describe("the coordinate that follows", '"wheel"', static=True)
    leader: str = describe("the coordinate that it follows", '"pinion"', static=True)
    ratio: Scalar = physical("follower/leader", "its rate by that of the leader", "-0.5")
    offset: Scalar = physical("follower", "its value where its leaders are zero", '"10 deg"', default=0.0)
    second: str | None = describe(
        "another coordinate that it follows", '"ring"', "one leader", static=True, default=None
    )
    second_ratio: Scalar | None = physical(
        "follower/second", "its rate by that of the second one", "0.7", "one leader", default=None
    )
    backlash: Scalar | None = physical(
        "follower", "the whole gap between the teeth, on the follower", '"4 arcmin"', "none", above=0.0, default=None
    )
    flank: AbstractNormalLaw | None = flatten(default=None)
    base_radius: Scalar | None = physical(
        "m", "base radius of the follower, whose teeth then load the bearings", '"37.6 mm"', "they do not", above=0.0,
        default=None,
    )  # fmt: skip
    friction: AbstractFrictionLaw | None = None
    sliding: Scalar | None = physical(
        "m", "mean distance of the teeth's contact from the pitch point", '"2 mm"', "none", above=0.0, default=None
    )

    def __check_init__(self):
        if (self.second is None) != (self.second_ratio is None):
            text = f"Coupling `{self.name}` needs `second` and `second_ratio`, or neither of them."
            raise ClearanceError(text).about(f"{self.name}.second_ratio")
        if self.second == self.leader:
            text = f"Coupling `{self.name}` names `{self.leader}` as `leader` and as `second`. Add up their ratios."
            raise ClearanceError(text).about(f"{self.name}.second")

        if self.base_radius is not None and (self.backlash is None or self.second is not None):
            text = f"Coupling `{self.name}` has teeth (`base_radius`): it needs one leader, `backlash` and `stiffness`."
            raise ClearanceError(text).about(f"{self.name}.base_radius")
        rubs = self.friction is not None
        if rubs != (self.sliding is not None) or (rubs and self.base_radius is None):
            text = f"Coupling `{self.name}` must have `friction`, `sliding` and `base_radius` together, or a gear"
            raise ClearanceError(f"{text} `friction` and `module`.").about(f"{self.name}.friction")
        if (self.backlash is None) != (self.flank is None):
            text = f"Coupling `{self.name}` needs a `backlash` and the law of its flanks (`stiffness`), or neither."
            raise ClearanceError(text).about(f"{self.name}.backlash")

    def demands(self):
        if self.base_radius is not None:
            yield Demand("ratio", self.ratio < 0, lambda: "must be below 0: teeth are known of external gears only")
        for name in ("ratio", "second_ratio"):
            if (ratio := getattr(self, name)) is not None:
                yield Demand(name, ratio != 0, lambda: "must not be 0")

    def units_by(self, kinds: Mapping[str, str]) -> dict[str, str]:
        """The units of its numbers by the words of its fields; `kinds`: units of coordinates by name."""
        units = coupling_units(kinds, self.follower, self.leader, self.second)
        return units if self.base_radius is None else units | {"coordinate": "m", "effort": "N"}

    @property
    def terms(self) -> tuple[tuple[str, Scalar], ...]:
        """Each leader with its ratio."""
        first = (self.leader, self.ratio)
        return (
            (first,) if self.second is None or self.second_ratio is None else (first, (self.second, self.second_ratio))
        )


def coupling_units(kinds: Mapping[str, str], follower: str, leader: str, second: str | None) -> dict[str, str]:
    """The units of a coupling's numbers by the words of its fields; `kinds`: units of coordinates by name."""
    unit = kinds.get(follower, "rad")
    others = {"leader": kinds.get(leader, unit), "second": kinds.get(second or "", unit)}
    ratios = {f"follower/{word}": "" if other == unit else f"{unit}/{other}" for word, other in others.items()}
    return ratios | {"follower": unit, "coordinate": unit, "effort": "N" if unit == "m" else "N*m"}


def _two(name: str, key: str, values: Sequence[float | int]) -> tuple[float, float]:
    if len(values) != 2:
        raise wrong_value(f"`{name}.{key}`", "two numbers", list(values), name=key)
    for value in values:
        if not value > 0:
            raise wrong_value(f"`{name}.{key}`", "greater than 0", value, name=key)
    first, second = values
    return float(first), float(second)


def _teeth(name: str, counts: Sequence[float | int]) -> tuple[float, float]:
    for count in counts:
        if count % 1 != 0 or count < LEAST_TEETH:
            raise wrong_value(f"`{name}.teeth`", f"whole numbers of at least {LEAST_TEETH}", count, name="teeth")
    return _two(name, "teeth", counts)


def Gear(
    name: str, follower: str, leader: str, teeth: Sequence[float | int], *, internal: bool = False,
    offset: Number = 0.0, backlash: Number | None = None, flank: AbstractNormalLaw | None = None,
    module: Number | None = None, pressure_angle: Number = math.pi / 9, friction: AbstractFrictionLaw | None = None,
) -> Coupling:  # fmt: skip
    """A pair of gears with parallel axes, or of bevel gears.

    **Arguments:** `name`, `follower`, `leader`, `offset`, `backlash`, `flank`: as in `Coupling`; `teeth`: numbers of
    teeth of the leader and of the follower; `internal`: whether one of them is a ring with teeth inside. Such a pair
    turns the same way, any other pair opposite ways. (Of bevel gears the sign depends on how their axes point:
    `internal` changes it.) With the `module` [m] of their teeth and the `pressure_angle` [rad] their forces load
    the bearings, see `base_radius` of `Coupling`; their `friction` is that of full teeth without profile shift.

    **Raises:** `ClearanceError` for fewer than 5 teeth, and for friction of gears that ever have more than two pairs of
    teeth in contact, or none.
    """
    first, second = _teeth(name, teeth)
    ratio = (1 if internal else -1) * first / second
    teeth_of: dict[str, Number] = {}
    if module is not None:
        teeth_of = {"base_radius": module * second / 2 * math.cos(pressure_angle)}
        if friction is not None:
            teeth_of["sliding"] = module * _mean_sliding(name, (first, second), float(pressure_angle))
    return Coupling(
        name, follower, leader, ratio, offset, backlash=backlash, flank=flank, friction=friction, **teeth_of
    )


def _mean_sliding(name: str, teeth: tuple[float, float], pressure_angle: float) -> float:
    """The mean distance from the pitch point of the teeth in contact, by the module: p/2 (1 - e + e1^2 + e2^2), with
    the base pitch p, and the contact ratio e = e1 + e2 by the parts of both tips. (Pairs share the force evenly: it is
    the loss factor of Ohlendorf, 1958, in Niemann and Winter.)
    """
    pitch = math.pi * math.cos(pressure_angle)
    tips = [math.sqrt((z / 2 + 1) ** 2 - (z / 2 * math.cos(pressure_angle)) ** 2) for z in teeth]
    parts = [(tip - z / 2 * math.sin(pressure_angle)) / pitch for tip, z in zip(tips, teeth, strict=True)]
    if not (1 <= sum(parts) <= 2 and max(parts) <= 1):
        text = f"Gear `{name}`: the mean sliding of its teeth is known with one or two pairs in contact, and it has"
        text += f" {sum(parts):.3g} in the mean. Give a `Coupling` with `sliding`."
        raise ClearanceError(text).about(f"{name}.friction")
    return pitch / 2 * (1 - sum(parts) + sum(part**2 for part in parts))


def Rack(
    name: str, follower: str, leader: str, radius: Number, *, offset: Number = 0.0,
    backlash: Number | None = None, flank: AbstractNormalLaw | None = None,
) -> Coupling:  # fmt: skip
    """A rack, the slide `follower`, moved by a pinion: x = radius q.

    **Arguments:** `name`, `follower`, `leader`, `offset` [m], `backlash` [m], `flank`: as in `Coupling`; `radius` [m]:
    pitch radius of the pinion, module times teeth / 2; negative where the rack moves the other way.
    """
    return Coupling(name, follower, leader, radius, offset, backlash=backlash, flank=flank)


def Screw(
    name: str, follower: str, leader: str, lead: Number, *, offset: Number = 0.0,
    backlash: Number | None = None, flank: AbstractNormalLaw | None = None,
) -> Coupling:  # fmt: skip
    """A screw: the slide `follower` moves by the lead a turn of the leader: x = lead q / (2 pi).

    **Arguments:** `name`, `follower`, `leader`, `offset` [m], `backlash` [m], `flank`: as in `Coupling`; `lead` [m]:
    negative of a left-hand thread.
    """
    return Coupling(name, follower, leader, lead / (2 * math.pi), offset, backlash=backlash, flank=flank)


def Belt(
    name: str, follower: str, leader: str, radii: Sequence[float | int], *, crossed: bool = False, offset: Number = 0.0
) -> Coupling:
    """A belt or a chain without slip.

    **Arguments:** `name`, `follower`, `leader`, `offset`: as in `Coupling`; `radii`: of the leader's and of the
    follower's pulley, or their numbers of teeth; `crossed`: whether the belt is, and turns the follower the other way.

    **Raises:** `ClearanceError` for a radius that is not positive.
    """
    first, second = _two(name, "radii", radii)
    return Coupling(name, follower, leader, (-1 if crossed else 1) * first / second, offset)


def Differential(name: str, cage: str, left: str, right: str, *, follower: str | None = None) -> Coupling:
    """A bevel differential: the cage turns by the mean of its side gears.

    **Arguments:** `name`: of the coupling; `cage`, `left`, `right`: names of coordinates, whose angles are against the
    same body; `follower`: which of the three follows the others (default: the cage).

    **Raises:** `ClearanceError` for a follower that is none of them.
    """
    return _solved(name, {cage: 1.0, left: -0.5, right: -0.5}, follower or cage)


def Planetary(
    name: str, sun: str, ring: str, carrier: str, teeth: Sequence[float | int], *, follower: str | None = None
) -> Coupling:
    """A planetary train by Willis' formula, with angles against the same body: q_sun + R q_ring = (1 + R) q_carrier,
    R = z_ring / z_sun.

    **Arguments:** `name`; `sun`, `ring`, `carrier`: names of coordinates; `teeth`: of the sun and of the ring;
    `follower`: which of the three follows the others (default: the carrier). Planets are gears of their own, on the
    carrier.

    **Raises:** `ClearanceError` for fewer than 5 teeth, a ring not larger than the sun, and a follower that is none of
    the three.
    """
    z_sun, z_ring = _teeth(name, teeth)
    if z_ring <= z_sun:
        raise wrong_value(f"`{name}.teeth`", "more on the ring than on the sun", list(teeth), name="teeth")
    ratio = z_ring / z_sun
    return _solved(name, {sun: 1.0, ring: ratio, carrier: -(1 + ratio)}, follower or carrier)


def _solved(name: str, factors: Mapping[str, float], follower: str) -> Coupling:
    """The coupling of sum k_i q_i = 0."""
    if len(factors) < 3:
        raise ClearanceError(f"Coupling `{name}` needs three coordinates, but names one of them twice.").about(name)
    if follower not in factors:
        raise unknown_name(f"The follower of coupling `{name}` must be one of its own.", follower, factors)
    (leader, ratio), (second, second_ratio) = (
        (other, -factor / factors[follower]) for other, factor in factors.items() if other != follower
    )
    return Coupling(name, follower, leader, ratio, second=second, second_ratio=second_ratio)


def without_backlash(couplings: Sequence[Coupling]) -> tuple[Coupling, ...]:
    """The couplings without backlash."""
    firm: dict[str, None] = dict.fromkeys(("backlash", "flank", "base_radius", "friction", "sliding"))
    return tuple(c if c.backlash is None else dataclasses.replace(c, **firm) for c in couplings)


def check_couplings(
    couplings: Sequence[Coupling], known: Mapping[str, bool], driven: Collection[str], elastic: Collection[str]
) -> None:
    """Raise where couplings do not fit: names, circles, drives. `known`: every coordinate of the tree by name, and
    whether it may be coupled (it is neither play nor a ball); `driven`: those that a drive prescribes; `elastic`: those
    of a drive that gives way.
    """
    by_name: dict[str, Coupling] = {}
    for coupling in couplings:
        what = f"Coupling `{coupling.name}`"
        for name in (coupling.follower, *(leader for leader, _ in coupling.terms)):
            if name not in known:
                allowed = [other for other, may in known.items() if may]
                raise unknown_name(f"{what} names `{name}`, but the tree has no such coordinate.", name, allowed)
            if not known[name]:
                raise ClearanceError(f"{what} names `{name}`, which is play, or no single angle or length.").about(name)
        if coupling.follower in by_name:
            both = f"`{by_name[coupling.follower].name}` and `{coupling.name}`"
            text = f"`{coupling.follower}` follows by the couplings {both}. Leave one of them."
            raise ClearanceError(text).about(coupling.follower)
        if coupling.follower in driven:
            text = f"{what} moves `{coupling.follower}`, which has a drive too: leave one of them."
            raise ClearanceError(text).about(coupling.follower)
        if coupling.follower in elastic:
            text = f"{what} moves `{coupling.follower}`, whose own drive gives way: leave one of them."
            raise ClearanceError(text).about(coupling.follower)
        by_name[coupling.follower] = coupling
    for coupling in couplings:
        for names in _ways(coupling.follower, by_name):
            if names[-1] in names[:-1]:
                circle = " follows ".join(f"`{name}`" for name in names[names.index(names[-1]) :])
                text = f"Coupling `{coupling.name}` goes round in a circle: {circle}. Let one of them lead."
                raise ClearanceError(text).about(coupling.follower)


def _ways(name: str, by_name: Mapping[str, Coupling], before: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """The ways from a follower to what leads it in the end, or to a name that was passed before."""
    way = (*before, name)
    if name in before or name not in by_name:
        yield way
        return
    for leader, _ in by_name[name].terms:
        yield from _ways(leader, by_name, way)


def leaders_of(name: str, couplings: Sequence[Coupling]) -> set[str]:
    """What a coordinate follows in the end; itself, if it follows nothing."""
    return {way[-1] for way in _ways(name, {coupling.follower: coupling for coupling in couplings})}
