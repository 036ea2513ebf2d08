from .cycle import PeriodicMotion as PeriodicMotion
from .modes import Mode as Mode
from .sensitivity import Hessian as Hessian
from .sensitivity import Sensitivities as Sensitivities
from .trust import GradientReport as GradientReport
from .trust import TrustThresholds as TrustThresholds
from .trust import UntrustedGradient as UntrustedGradient
