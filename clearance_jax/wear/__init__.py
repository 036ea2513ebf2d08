"""Wear of pins and sleeves: laws, pressures, what wears off along a motion and over a life."""

from clearance_jax.wear.after import AbstractAged, AfterWear
from clearance_jax.wear.contacts import Contacts, contacts, sections_of
from clearance_jax.wear.criteria import AbstractCriterion, Deepest, Exceeds, ImpactSpeed
from clearance_jax.wear.history import WearHistory, march, simulate_wear
from clearance_jax.wear.laws import (
    AbstractWearLaw,
    Archard,
    Graded,
    Reye,
    RunningIn,
    SlidingState,
    Threshold,
    archard,
    reye,
)
from clearance_jax.wear.model import WearModel
from clearance_jax.wear.pressure import (
    AbstractPressure,
    Foundation,
    HertzLine,
    Section,
    SectionLoad,
    Uniform,
    foundation,
)
from clearance_jax.wear.record import to_dataset
from clearance_jax.wear.service import Failures, ServiceLives, service_lives
from clearance_jax.wear.worn import SectorsWarning, Wear, wear, wear_of

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
    "Reye",
    "RunningIn",
    "Section",
    "SectionLoad",
    "SectorsWarning",
    "ServiceLives",
    "SlidingState",
    "Threshold",
    "Uniform",
    "Wear",
    "WearHistory",
    "WearModel",
    "archard",
    "contacts",
    "foundation",
    "march",
    "reye",
    "sections_of",
    "service_lives",
    "simulate_wear",
    "to_dataset",
    "wear",
    "wear_of",
]
