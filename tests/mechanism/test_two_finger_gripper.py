"""A gripper whose two fingers are parallelograms, so that five joints follow one: Robotiq's 2F-85, with the masses and
places of its URDF file, as the package airo-models has it. The numbers are those of its mass matrix with the followers
eliminated by hand, and of pinocchio 4.1 with `mimic=True`.
"""

import jax.numpy as jnp
import numpy as np
import pytest

import clearance_jax as cj
from clearance_jax.dynamics.field import energies, slope
from clearance_jax.dynamics.kinematics import frames
from clearance_jax.mechanism.state import State

NOW = jnp.zeros(())
LIMIT = '<limit lower="0" upper="0.8" effort="1000" velocity="2"/>'
# Of each link: mass, centre of mass, and moments of inertia (xx, xy, xz, yy, yz, zz). All axes are along x, so that xy
# and xz play no part.
LINKS = {
    "outer_knuckle": (
        0.00853198276973456,
        "-0.000200000000003065 0.0199435877845359 0.0292245259211331",
        (2.89328108496468e-06, 0.0, 0.0, 1.86719750325683e-06, -1.21858577871576e-06, 1.21905238907251e-06),
    ),
    "outer_finger": (
        0.022614240507152,
        "0.00030115855001899 0.0373907951953854 -0.0208027427000385",
        (1.52518312458174e-05, 9.8e-10, -5.4e-10, 6.17694243867776e-06, 6.78636130740228e-06, 1.16494917907219e-05),
    ),
    "inner_finger": (
        0.0104003125914103,
        "0.000299999999999317 0.0160078233491243 -0.0136945669206257",
        (2.71909453810972e-06, 0.0, 0.0, 7.69100314106116e-07, 6.74715432769696e-07, 2.30315190420171e-06),
    ),
    "inner_knuckle": (
        0.0271177346495152,
        "0.000123011831763771 0.0507850843201817 0.00103968640075166",
        (2.61910379223783e-05, -2.4e-07, -6.4e-09, 2.8270243746167e-06, -5.37200748039765e-07, 2.83695868220296e-05),
    ),
}


def link(name, mass, center, moments) -> str:
    words = " ".join(
        f'i{of}="{moment}"' for of, moment in zip(("xx", "xy", "xz", "yy", "yz", "zz"), moments, strict=True)
    )
    inertial = f'<origin xyz="{center}"/><mass value="{mass}"/><inertia {words}/>'
    return f'<link name="{name}"><inertial>{inertial}</inertial></link>'


def joint(name, parent, child, at, turn=0.0, follows=None) -> str:
    mimic = "" if follows is None else f'<mimic joint="finger_joint" multiplier="{follows}"/>'
    return (
        f'<joint name="{name}" type="revolute"><origin xyz="{at}" rpy="0 0 {turn}"/><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="1 0 0"/>{LIMIT}{mimic}</joint>'
    )


def fixed(parent, child, at) -> str:
    ends = f'<origin xyz="{at}"/><parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{child}_joint" type="fixed">{ends}</joint>'


def side(name, sign, turn) -> str:
    """A finger: a parallelogram of knuckles, whose second half follows."""
    first, leads = (f"{name}_outer_knuckle_joint", 1) if sign > 0 else ("finger_joint", None)
    return "".join(
        (
            *(link(f"{name}_{part}", *values) for part, values in LINKS.items()),
            f'<link name="{name}_pad"/>',
            joint(first, "base", f"{name}_outer_knuckle", f"0 {sign * 0.0306011} 0.054904", turn, leads),
            fixed(f"{name}_outer_knuckle", f"{name}_outer_finger", "0 0.0315 -0.0041"),
            joint(f"{name}_a", f"{name}_outer_finger", f"{name}_inner_finger", "0 0.0061 0.0471", follows=-1),
            joint(f"{name}_b", "base", f"{name}_inner_knuckle", f"0 {sign * 0.0127} 0.06142", turn, 1),
            fixed(f"{name}_inner_finger", f"{name}_pad", "0 -0.0220203446692936 0.03242"),
        )
    )


@pytest.fixture(scope="module")
def gripper(tmp_path_factory) -> cj.Mechanism:
    path = tmp_path_factory.mktemp("gripper") / "gripper.urdf"
    fingers = side("left", -1, np.pi) + side("right", 1, 0)
    path.write_text(f'<robot name="gripper"><link name="base"/>{fingers}</robot>', encoding="utf-8")
    return cj.load_urdf(path, end_effector=["left_pad", "right_pad"])


def test_its_fingers_translate(gripper):
    """The inertia at every opening is the same, so that nothing depends on the speed."""
    ready = gripper.prepare()
    assert [c.name for c in gripper.free_coordinates()] == ["finger_joint"]
    assert len(gripper.couplings) == 5
    for angle, torque in {0.0: 0.0685973972261, 0.4: 0.0619477466458, 0.8: 0.0455179089775}.items():
        inertia = 2 * float(energies(NOW, jnp.array([angle, 1.0]), ready).kinetic)
        assert inertia == pytest.approx(5.60539444881e-4, rel=1e-11)
        still, moving = (float(slope(NOW, jnp.array([angle, rate]), ready)[1]) for rate in (0.0, 7.0))
        assert inertia * still == pytest.approx(-torque, rel=1e-11)
        assert moving == pytest.approx(still, rel=1e-9)


def test_its_pads_stay_upright(gripper):
    ready = gripper.prepare()
    turned = {}
    for angle, apart in {0.0: 92.3615106614, 0.4: 52.9353199719, 0.8: 7.8612313870}.items():
        motion = frames(ready, NOW, State((jnp.asarray(angle),), (NOW,), {}))
        pads = [motion[point.body].move_origin(point.at.vector) for point in ready.points]
        between = np.subtract(*(np.array([float(x) for x in pad.position]) for pad in pads))
        assert 1e3 * np.linalg.norm(between) == pytest.approx(apart, rel=1e-11)
        turned[angle] = np.array([[[float(x) for x in row] for row in pad.rotation.rows] for pad in pads])
    np.testing.assert_allclose(turned[0.4], turned[0.0], atol=1e-14)
    np.testing.assert_allclose(turned[0.8], turned[0.0], atol=1e-14)
