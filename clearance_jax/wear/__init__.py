"""Wear of pins and sleeves: laws, pressures, what wears off along a motion and over a life."""

from clearance_jax.wear.after import AbstractAged, AfterWear
from clearance_jax.wear.contacts import Contacts, contacts, sections_of
from clearance_jax.wear.criteria import AbstractCriterion, Deepest, Exceeds, ImpactSpeed
from clearance_jax.wear.laws import (
    AbstractWearLaw,
    Archard,
    Graded,
    Reye,
    Rubbing,
    RunningIn,
    Threshold,
    archard,
    reye,
)
from clearance_jax.wear.life import Life, life, march
from clearance_jax.wear.lives import Failures, Lives, lives
from clearance_jax.wear.pressure import AbstractPressure, Foundation, HertzLine, Pressed, Section, Uniform, foundation
from clearance_jax.wear.record import to_dataset
from clearance_jax.wear.sectors import SectorsWarning
from clearance_jax.wear.wearing import Wearing
from clearance_jax.wear.worn import Wear, wear, worn

__all__ = [
    "AbstractAged",
    "AbstractCriterion",
    "AbstractPressure",
    "AbstractWearLaw",
    "AfterWear",
    "Archard",
    "Contacts",
    "Deepest",
    "Exceeds",
    "Failures",
    "Foundation",
    "Graded",
    "HertzLine",
    "ImpactSpeed",
    "Life",
    "Lives",
    "Pressed",
    "Reye",
    "Rubbing",
    "RunningIn",
    "Section",
    "SectorsWarning",
    "Threshold",
    "Uniform",
    "Wear",
    "Wearing",
    "archard",
    "contacts",
    "foundation",
    "life",
    "lives",
    "march",
    "reye",
    "sections_of",
    "to_dataset",
    "wear",
    "worn",
]
