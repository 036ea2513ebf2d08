"""One example of every law; the contract suites run over these."""

import jax.numpy as jnp
import numpy as np

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.laws.stiffness import Stiffened

K = 6.61e10
STEEL = 2.07e11, 2.07e11
NORMAL = {
    "kelvin-voigt": laws.LinearKelvinVoigt(1e7, 500.0),
    "kelvin-voigt-unclipped": laws.LinearKelvinVoigt(1e7, 500.0, clipped=False),
    "smoothed-onset": laws.SmoothedOnset(laws.LinearKelvinVoigt(1e7, 500.0), 1e-6),
    "stiffened": Stiffened(laws.HuntCrossley(K, 0.5), 3.0),
    "hertz": laws.Hertz(K),
    "hertz-n": laws.Hertz(K, 1.8),
    "adams-impact": laws.AdamsImpact(K, 2000.0, 1e-5),
    "hunt-crossley": laws.HuntCrossley(K, 0.5),
    "exact-restitution": laws.exact_restitution(K, 0.7),
    "lankarani-nikravesh": laws.lankarani_nikravesh(K, 0.7),
    "flores": laws.flores(K, 0.7),
    "hunt-crossley-1975": laws.hunt_crossley(K, 0.7),
    "herbert-mcwhannell": laws.herbert_mcwhannell(K, 0.7),
    "lee-wang": laws.lee_wang(K, 0.7),
    "gonthier": laws.gonthier(K, 0.7),
    "zhiying-qishao": laws.zhiying_qishao(K, 0.7),
    "hu-guo": laws.hu_guo(K, 0.7),
    "gharib-hurmuzlu": laws.gharib_hurmuzlu(K, 0.7),
    "tsuji": laws.Tsuji(K, 0.7, 0.14),
    "tsuji-clipped": laws.Tsuji(K, 0.7, 0.14, clipped=True),
    "anagnostopoulos": laws.Anagnostopoulos(1e7, 0.7, 0.14),
    "johnson": laws.johnson(*STEEL),
    "johnson-damped": laws.johnson(*STEEL, restitution=0.7),
    "radzimovsky": laws.radzimovsky(*STEEL),
    "esdu-78035": laws.esdu(*STEEL),
    "liu": laws.liu(*STEEL),
    "bai-zhao": laws.bai_zhao(*STEEL, restitution=0.7),
    "pereira": laws.pereira(*STEEL, restitution=0.7),
    "goldsmith": laws.goldsmith(*STEEL),
    "dubowsky-freudenstein": laws.dubowsky_freudenstein(*STEEL),
    "winkler": laws.Winkler(2e13),
    "winkler-damped": laws.Winkler(2e13, 0.7),
    "standard-linear-solid": laws.StandardLinearSolid(1e7, 0.4, 5e-3),
    "smoothed-hunt-crossley": laws.HuntCrossley(K, 0.5).smoothed(1e-6),
    "smoothed-flores": laws.flores(K, 0.7).smoothed(1e-6),
}
FRICTION = {
    "cubic": laws.CubicCoulomb(0.3, 1e-2),
    "tanh": laws.TanhCoulomb(0.3, 1e-2),
    "brown-mcphee": laws.BrownMcPhee(0.4, 0.3, 1e-2),
    "lugre": laws.LuGre(0.4, 0.3, 1e-3, 1e5, 1e-2, 0.0),
    "adams": laws.AdamsFriction(0.4, 0.3, 1e-3, 1e-2),
    "threlfall": laws.Threlfall(0.3, 1e-2),
    "ambrosio": laws.Ambrosio(0.3, 1e-3, 1e-2),
    "bengisu-akay": laws.BengisuAkay(0.4, 0.3, 1e-2, 5e-3),
    "stribeck": laws.Stribeck(0.4, 0.3, 1e-3, 1e-2),
    "stribeck-1": laws.Stribeck(0.4, 0.3, 1e-3, 1e-2, 1.0),
    "dahl": laws.Dahl(0.3, 1e5),
    "elasto-plastic": laws.ElastoPlastic(0.4, 0.3, 1e-3, 1e5, 1e-2),
    "smoothed-cubic": laws.CubicCoulomb(0.3, 1e-2).smoothed(1e-3),
    "smoothed-threlfall": laws.Threlfall(0.3, 1e-2).smoothed(1e-3),
    "smoothed-lugre": laws.LuGre(0.4, 0.3, 1e-3, 1e5, 1e-2, 0.0).smoothed(1e-5),
    "smoothed-elasto-plastic": laws.ElastoPlastic(0.4, 0.3, 1e-3, 1e5, 1e-2).smoothed(1e-5),
}


def slider_crank(clearance: float = 5e-4, **changes) -> cj.Mechanism:
    """The reference problem: massless crank at 5000 rpm, one clearance joint between conrod and slider."""
    compliance = 2 * (1 - 0.3**2) / 207e9
    stiffness = 4 / (3 * compliance) * np.sqrt(0.01 * 0.0105 / 0.0005)
    wrist = cj.RevoluteClearance(
        clearance, 0.01, laws.AdamsImpact(stiffness, 2000.0, 1e-5), laws.TanhCoulomb(0.03, 0.01)
    )
    return cj.Mechanism(
        bodies=(
            cj.Body("crank"),
            cj.Body("conrod", 0.21, 2.5e-4, cj.Position(0.06)),
            cj.Body("slider", 0.14),
        ),
        joints=(
            cj.Revolute("main", "ground", "crank", motion=cj.Motion(cj.drives.ConstantSpeed(5000 * np.pi / 30))),
            cj.Revolute("crankpin", "crank", "conrod", at_parent=cj.Position(0.05)),
            cj.Prismatic("guide", "ground", "slider", motion=cj.Motion(position=0.17)),
        ),
        loops=(cj.Revolute("wrist", "conrod", "slider", at_parent=cj.Position(0.12), clearance=wrist),),
        points=(cj.Point("piston", "slider"),),
    )


def playful_servo() -> cj.Mechanism:
    """An arm on a servo whose joint has play: without it the arm still moves freely."""
    motion = cj.Motion(actuators=(cj.actuators.Servo(cj.drives.Harmonic(0.3, 10.0), 50.0, 5.0),))
    play = cj.RevoluteClearance(1e-4, 0.01, laws.HuntCrossley(1e9, 0.5))
    return cj.Mechanism(
        bodies=(cj.Body("arm", 1.0, 0.01, cj.Position(0.1)),),
        joints=(cj.Revolute("hip", "ground", "arm", motion=motion, clearance=play),),
        points=(cj.Point("tip", "arm", cj.Position(0.2)),),
        gravity=cj.Gravity(y=-9.81),
    )


def no_memory():
    return jnp.zeros(0)
