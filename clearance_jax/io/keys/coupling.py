"""Every key of a coupling in a scene file."""

import dataclasses

from clearance_jax.io.keys.declare import family, keys_of, kind, optional, summary
from clearance_jax.io.keys.kinds import Flag, OneOrSeveral, Quantities, Sub, Text, quantity
from clearance_jax.laws import Flank
from clearance_jax.mechanism.couplings import Belt, Coupling, Differential, Gear, Planetary, Rack, Screw

_FLANK = keys_of(Flank)
FLANK_KEYS = _FLANK | {
    "stiffness": OneOrSeveral(
        "stiffness of the flanks; several up to the next of the `efforts`", '"50 kN*m/rad"', unit="effort/coordinate",
        bounds={"above": 0.0}, required=True,
    )
}  # fmt: skip
"""The keys of the law of flanks."""
_BACKLASH = keys_of(Coupling, "backlash") | optional(FLANK_KEYS, stiffness="there is no `backlash`")
_FOLLOWS = keys_of(Coupling, "follower", "leader", "offset")
_SLIDES = _FOLLOWS | {"offset": dataclasses.replace(_FOLLOWS["offset"], example='"10 mm"')}
_OF_SLIDES = {"backlash": '"50 um"', "stiffness": '"20 kN/mm"', "damping": '"2 kN*s/m"', "efforts": '["1 kN", "5 kN"]'}
_OF_SLIDES |= {"damping_factor": '"10 s/m"', "cubic": '"1e15 N/m^3"'}
_SLACK = {n: dataclasses.replace(key, example=_OF_SLIDES.get(n, key.example)) for n, key in _BACKLASH.items()}
FRICTION = Sub(
    "law of the friction of teeth that bear forces (keys as of `joint.NAME.friction`)",
    '{ law = "tanh", coefficient = 0.06, transition_speed = "10 mm/s" }',
    "no friction",
)
_TRAIN = Text("which of them follows the others", '"ring"')
_LOADS = "module of the teeth, which then load the bearings with forces (the flanks' law is one of N and m)"
_OF_GEARS = {
    "teeth": Quantities("numbers of teeth, of the leader and of the follower", "[20, 40]", required=True),
    "internal": Flag("whether one of them is a ring with teeth inside", "true", default=False),
    "module": quantity(_LOADS, '"2 mm"', "m", "they load nothing but the other wheel", above=0.0),
    "pressure_angle": quantity("pressure angle of the teeth", '"20 deg"', "rad", "20 deg", above=0.0),
    "friction": FRICTION,
}
_OF_RACKS = {"radius": quantity("pitch radius of the pinion", '"20 mm"', "m", required=True)}
_OF_SCREWS = {"lead": quantity("slide by turn of the leader", '"5 mm"', "m", required=True)}
_OF_BELTS = {
    "radii": Quantities("radii of the pulleys, the leader's first", '["20 mm", "50 mm"]', unit="m", required=True),
    "crossed": Flag("whether it turns the follower the other way", "true", default=False),
}
_OF_DIFFERENTIALS = {
    "cage": Text("coordinate of the cage", '"cage"', required=True),
    "left": Text("coordinate of its one side gear", '"left"', required=True),
    "right": Text("coordinate of its other side gear", '"right"', required=True),
    "follower": dataclasses.replace(_TRAIN, absent="the cage"),
}
_OF_TRAINS = {
    "sun": Text("coordinate of the sun", '"sun"', required=True),
    "ring": Text("coordinate of the ring", '"ring"', required=True),
    "carrier": Text("coordinate of the carrier", '"carrier"', required=True),
    "teeth": Quantities("numbers of teeth, of the sun and of the ring", "[24, 60]", required=True),
    "follower": dataclasses.replace(_TRAIN, absent="the carrier"),
}
COUPLINGS = {
    "linear": (Coupling, kind(summary(Coupling), **keys_of(Coupling) | _BACKLASH, friction=FRICTION)),
    "gear": (Gear, kind(summary(Gear), **_FOLLOWS, **_OF_GEARS, **_BACKLASH)),
    "rack": (Rack, kind(summary(Rack), **_SLIDES, **_OF_RACKS, **_SLACK)),
    "screw": (Screw, kind(summary(Screw), **_SLIDES, **_OF_SCREWS, **_SLACK)),
    "belt": (Belt, kind(summary(Belt), **_FOLLOWS, **_OF_BELTS)),
    "differential": (Differential, kind(summary(Differential), **_OF_DIFFERENTIALS)),
    "planetary": (Planetary, kind(summary(Planetary), **_OF_TRAINS)),
}
COUPLING_TABLES = family(
    "coupling.NAME",
    "Couplings",
    "type",
    "the kind of coupling",
    {word: keys for word, (_, keys) in COUPLINGS.items()},
    default="linear",
)
