"""Normal laws. Adding one: its class or function, a line here, a catalogue line in the tests."""

from clearance_jax.laws.normal.constant_restitution import Anagnostopoulos, Tsuji
from clearance_jax.laws.normal.line import LineContact as LineContact
from clearance_jax.laws.normal.line import (
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
from clearance_jax.laws.normal.power_laws import AdamsImpact, Hertz, HuntCrossley, LinearKelvinVoigt
from clearance_jax.laws.normal.restitution import RestitutionLaw as RestitutionLaw
from clearance_jax.laws.normal.restitution import (
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
