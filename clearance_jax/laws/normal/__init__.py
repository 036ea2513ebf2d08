"""Normal laws. Adding one: its class or function, a line here, a catalogue line in the tests."""

from clearance_jax.laws.normal.adams import AdamsImpact
from clearance_jax.laws.normal.constant_restitution import Anagnostopoulos, Tsuji
from clearance_jax.laws.normal.hertz import Hertz, HuntCrossley
from clearance_jax.laws.normal.line import (
    LineContact,
    Winkler,
    bai_zhao,
    dubowsky_freudenstein,
    esdu,
    goldsmith,
    johnson,
    liu,
    pereira,
    radzimovsky,
)
from clearance_jax.laws.normal.linear import LinearKelvinVoigt
from clearance_jax.laws.normal.restitution import (
    RestitutionLaw,
    exact_restitution,
    flores,
    gharib_hurmuzlu,
    gonthier,
    herbert_mcwhannell,
    hu_guo,
    hunt_crossley,
    lankarani_nikravesh,
    lee_wang,
    zhiying_qishao,
)
from clearance_jax.laws.normal.viscoelastic import StandardLinearSolid

NORMAL_LAWS = {
    "kelvin-voigt": LinearKelvinVoigt,
    "hertz": Hertz,
    "adams-impact": AdamsImpact,
    "hunt-crossley": HuntCrossley,
    "exact-restitution": exact_restitution,
    "lankarani-nikravesh": lankarani_nikravesh,
    "flores": flores,
    "hunt-crossley-1975": hunt_crossley,
    "herbert-mcwhannell": herbert_mcwhannell,
    "lee-wang": lee_wang,
    "gonthier": gonthier,
    "zhiying-qishao": zhiying_qishao,
    "hu-guo": hu_guo,
    "gharib-hurmuzlu": gharib_hurmuzlu,
    "tsuji": Tsuji,
    "anagnostopoulos": Anagnostopoulos,
    "johnson": johnson,
    "radzimovsky": radzimovsky,
    "esdu-78035": esdu,
    "liu": liu,
    "bai-zhao": bai_zhao,
    "pereira": pereira,
    "goldsmith": goldsmith,
    "dubowsky-freudenstein": dubowsky_freudenstein,
    "winkler": Winkler,
    "standard-linear-solid": StandardLinearSolid,
}
"""Normal laws by the name a scene file gives them."""

__all__ = [
    "NORMAL_LAWS",
    "AdamsImpact",
    "Anagnostopoulos",
    "Hertz",
    "HuntCrossley",
    "LineContact",
    "LinearKelvinVoigt",
    "RestitutionLaw",
    "StandardLinearSolid",
    "Tsuji",
    "Winkler",
    "bai_zhao",
    "dubowsky_freudenstein",
    "esdu",
    "exact_restitution",
    "flores",
    "gharib_hurmuzlu",
    "goldsmith",
    "gonthier",
    "herbert_mcwhannell",
    "hu_guo",
    "hunt_crossley",
    "johnson",
    "lankarani_nikravesh",
    "lee_wang",
    "liu",
    "pereira",
    "radzimovsky",
    "zhiying_qishao",
]
