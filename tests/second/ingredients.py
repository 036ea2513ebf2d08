"""Parts of random scenes: tables of laws, drives and fillings with random numbers."""

import numpy as np

from .quantities import number


class Draw:
    """Random numbers as quantities, and random choices, each by a seed of its own: scenes that differ in their numbers
    alone are one program of the library.
    """

    def __init__(self, structure: int, numbers: int = 0):
        self.choices, self.rng = np.random.default_rng(structure), np.random.default_rng([structure, numbers])

    def number(self, low: float, high: float) -> float:
        """A number, evenly in its logarithm where it cannot be negative, with four digits."""
        value = np.exp(self.rng.uniform(np.log(low), np.log(high))) if low > 0 else self.rng.uniform(low, high)
        return float(f"{value:.4g}")

    def quantity(self, low: float, high: float, unit: str) -> str:
        """The same with a unit."""
        return f"{self.number(low, high)} {unit}"

    def one(self, among):
        """One of several."""
        among = list(among)
        return among[int(self.choices.integers(len(among)))]

    def shuffled(self, among) -> list:
        """All of them in a random order."""
        among = list(among)
        return [among[i] for i in self.choices.permutation(len(among))]


STEEL = ("pin_modulus", "sleeve_modulus")
RESTITUTION = (
    "exact-restitution",
    "lankarani-nikravesh",
    "flores",
    "hunt-crossley-1975",
    "herbert-mcwhannell",
    "lee-wang",
    "gonthier",
    "zhiying-qishao",
    "hu-guo",
    "gharib-hurmuzlu",
)
POWER = ("hertz", "hunt-crossley", "adams-impact", "tsuji", "standard-linear-solid", *RESTITUTION)
LINEAR = ("kelvin-voigt", "anagnostopoulos")
LINE = ("johnson", "radzimovsky", "esdu-78035", "liu", "winkler")
NORMAL = (*POWER, *LINEAR, *LINE)
JUMPING = ("kelvin-voigt", "anagnostopoulos")
"""Laws of class C-1, which have no derivatives."""


def normal(law: str, draw: Draw) -> dict:
    """A normal law's table, of contacts that last some tenths of a millisecond."""
    table: dict = {"law": law}
    if law in LINE:
        if law == "winkler":
            table["stiffness"] = draw.quantity(5e11, 2e12, "Pa/m")
        else:
            table |= {key: draw.quantity(1.0, 4.0, "GPa") for key in STEEL}
        if draw.one((True, False)):
            table["restitution"] = draw.number(0.4, 0.9)
        return table
    if law in LINEAR:
        table["stiffness"] = draw.quantity(1e6, 4e6, "N/m")
    elif law == "standard-linear-solid":
        table["stiffness"] = draw.quantity(1e6, 4e6, "N/m")
        table |= {"relaxing_share": draw.number(0.2, 0.6), "relaxation_time": draw.quantity(0.2, 2.0, "ms")}
    else:
        table["stiffness"] = draw.quantity(1e9, 5e9, "N/m^1.5")
        if law != "tsuji" and draw.one((True, False, False)):
            table["exponent"] = 1.4
            table["stiffness"] = draw.quantity(3e8, 1e9, "N/m^1.4")
    if law in RESTITUTION:
        table["restitution"] = draw.number(0.15, 0.3) if law == "gharib-hurmuzlu" else draw.number(0.5, 0.9)
    if law in ("tsuji", "anagnostopoulos"):
        table |= {"restitution": draw.number(0.5, 0.9), "effective_mass": draw.quantity(0.1, 0.3, "kg")}
    if law in ("tsuji", "anagnostopoulos", "kelvin-voigt") and draw.one((True, False)):
        table["clipped"] = draw.one((True, False))
    if law == "kelvin-voigt":
        table["damping"] = draw.quantity(20.0, 200.0, "N*s/m")
    if law == "hunt-crossley":
        table["damping_factor"] = draw.quantity(0.3, 3.0, "s/m")
    if law == "adams-impact":
        table |= {"damping": draw.quantity(50.0, 300.0, "N*s/m"), "full_damping_depth": draw.quantity(2.0, 10.0, "um")}
    return table


BRISTLES = ("dahl", "lugre", "elasto-plastic")
CURVES = ("cubic", "tanh", "brown-mcphee", "adams", "threlfall", "ambrosio", "bengisu-akay", "stribeck")
FRICTION = ("none", *CURVES, *BRISTLES)


def friction(law: str, draw: Draw) -> dict:
    """A friction law's table."""
    table: dict = {"law": law}
    low, high = draw.number(0.05, 0.15), draw.number(0.16, 0.3)
    speed = draw.quantity(20.0, 60.0, "mm/s")
    if law in ("cubic", "tanh", "threlfall", "ambrosio", "dahl"):
        table["coefficient"] = low
    if law in ("brown-mcphee", "adams", "bengisu-akay", "stribeck"):
        table |= {"static_coefficient": high, "dynamic_coefficient": low}
    if law in CURVES:
        table["transition_speed"] = speed
    if law == "ambrosio":
        table["free_speed"] = draw.quantity(2.0, 10.0, "mm/s")
    if law == "adams":
        table["stiction_speed"] = draw.quantity(4.0, 15.0, "mm/s")
    if law == "bengisu-akay":
        table["decay_speed"] = draw.quantity(5.0, 30.0, "mm/s")
    if law == "stribeck":
        table |= {"stribeck_speed": draw.quantity(5.0, 20.0, "mm/s"), "shape": draw.one((1, 2))}
        table["viscous"] = draw.quantity(0.01, 0.1, "s/m")
    if law in BRISTLES:
        table["bristle_stiffness"] = draw.quantity(1e4, 5e4, "1/m")
    if law in ("lugre", "elasto-plastic"):
        table |= {"static_coefficient": high, "kinetic_coefficient": low}
        table["stribeck_speed"] = draw.quantity(5.0, 20.0, "mm/s")
        table["bristle_damping"] = draw.quantity(0.1, 1.0, "s/m")
    return table


FILLING = ("none", "damper", "preloaded-bearing", "short-bearing")


def filling(kind: str, draw: Draw, joint: dict, space: bool) -> dict:
    """A filling's table, for a joint with its clearance and size."""
    if kind == "damper":
        table = {"radial": draw.quantity(20.0, 200.0, "N*s/m")}
        return {"type": kind, **table, **({"tilt": draw.quantity(0.01, 0.1, "N*m*s/rad")} if space else {})}
    if kind == "preloaded-bearing":
        table = {"radial_stiffness": draw.quantity(2e5, 2e6, "N/m"), "radial_preload": draw.quantity(2.0, 20.0, "N")}
        tilt = {"tilt_stiffness": draw.quantity(20.0, 200.0, "N*m/rad"), "tilt_preload": draw.quantity(0.1, 1.0, "N*m")}
        return {"type": kind, **table, **(tilt if space else {}), "damping_time": draw.quantity(1.0, 20.0, "us")}
    c, radius, length = (number(joint[key]) for key in ("radial_clearance", "pin_radius", "length"))
    # Damping of small motions; a usual oil would be so stiff that explicit steps cannot follow.
    viscosity = draw.number(10.0, 50.0) * c**3 / (np.pi * radius * length**3)
    roughness = f"{draw.number(0.08, 0.15) * c:.4g} m"
    return {"type": kind, "viscosity": f"{viscosity:.5g} Pa*s", "roughness": roughness}


DRIVES = ("constant-speed", "harmonic", "step", "step5", "spline", "trapezoid")
EFFORTS = ("constant", "servo", "spring", "friction")
MOTION = (*DRIVES, *(f"actuator {kind}" for kind in EFFORTS), "load", "spring of points")


def drive(kind: str, draw: Draw, start: float, t1: float, turns: bool, pace: float = 1.0) -> dict:
    """A drive's table, of a coordinate that begins at `start` and moves fast enough for touches within t1."""
    unit, size = ("rad", 1.0) if turns else ("m", 0.05)
    speed = float(f"{draw.number(15.0, 40.0) * size * pace:.4g}") * draw.one((-1, 1))
    at, rise = f"{start!r} {unit}", f"{speed * t1 * 0.4:.6g} {unit}"
    if kind == "constant-speed":
        return {"type": kind, "speed": f"{speed} {unit}/s", "start": at}
    if kind == "harmonic":
        table = {"amplitude": f"{abs(speed) / 500:.5g} {unit}", "angular_frequency": "500 rad/s"}
        return {"type": kind, **table, "offset": at}
    if kind in ("step", "step5"):
        times = {"begin": ["0 s", f"{0.5 * t1:.6g} s"], "end": [f"{0.45 * t1:.6g} s", f"{1.3 * t1:.6g} s"]}
        return {"type": kind, **times, "rise": [rise, rise], "offset": at}
    if kind == "trapezoid":
        times = {"begin": ["0 s"], "duration": [f"{1.2 * t1:.6g} s"], "cruise": 0.4}
        return {"type": kind, **times, "rise": [rise], "offset": at}
    times = [f"{x * t1:.6g} s" for x in (-0.1, 0.3, 0.6, 0.8, 1.1)]
    # Its value at t = 0 is not the start: the tree begins where the drive says, and loops close about it.
    values = [f"{start + speed * t1 * x!r} {unit}" for x in (0.0, 0.2, 0.5, 0.45, 0.9)]
    return {"type": "spline", "times": times, "values": values}


def effort(kind: str, draw: Draw, start: float, turns: bool) -> dict:
    """An actuator's table."""
    per = "N*m" if turns else "N"
    angle = "rad" if turns else "m"
    size = 1.0 if turns else 20.0
    if kind == "constant":
        return {"type": kind, "effort": f"{draw.number(1.0, 4.0) * size * draw.one((-1, 1)):.5g} {per}"}
    if kind == "friction":
        table = {"effort": f"{draw.number(0.5, 2.0) * size:.5g} {per}", "transition_speed": f"0.5 {angle}/s"}
        return {"type": kind, **table}
    gains = {
        "stiffness": f"{draw.number(20, 80) * size:.5g} {per}/{angle}",
        "damping": f"{draw.number(0.02, 0.1) * size:.5g} {per}*s/{angle}",
    }
    if kind == "spring":
        return {"type": kind, **gains, "rest": f"{start + 0.05 * draw.one((-1, 1))!r} {angle}"}
    target = {"type": "harmonic", "amplitude": f"{0.05 if turns else 0.003} {angle}", "offset": f"{start!r} {angle}"}
    return {"type": kind, **gains, "target": {**target, "angular_frequency": "300 rad/s"}}
