"""Figures of a motion, by name: `cj.figures.overview(dataset)`, or `clearance plot RESULT --plot-kind overview`.

A kind of figure is a class here, which the command's help and errors read. What draws it is imported when it draws.
"""

import abc
from typing import Any, ClassVar

from clearance_jax.errors import unknown_name


class AbstractFigure(abc.ABC):
    """A kind of figure of a motion, with its `name`. The first sentence of its docstring is the command's help."""

    name: ClassVar[str]

    @abc.abstractmethod
    def draw(self, dataset: Any, narrow: bool = False) -> Any:
        """The matplotlib `Figure` of a `dataset` (of `to_dataset`). `narrow`: panels below each other, for a screen of
        390 pixels. **Raises** `ClearanceError` for a dataset that has nothing to show.
        """

    def __call__(self, dataset: Any, narrow: bool = False, **options: Any) -> Any:
        """As `draw`."""
        return self.draw(dataset, narrow, **options)


class Overview(AbstractFigure):
    """Mechanism, error, contact forces apart from the first fall, eccentricity, when pins bear, their orbits.

    The error is that of each named point against the ideal mechanism. Of more than six joints with play it shows those
    with the largest forces. Without play it is `motion`.

    **Arguments:** `dataset`, `narrow`: as `AbstractFigure.draw`.
    """

    name = "overview"

    def draw(self, dataset: Any, narrow: bool = False) -> Any:
        from clearance_jax.report.overview import draw_overview

        return draw_overview(dataset, narrow)


class MotionFigure(AbstractFigure):
    """Coordinates, speeds and accelerations of points, efforts of drives or reactions in joints, paths of points.

    **Arguments:** `dataset`, `narrow`: as `AbstractFigure.draw`.
    """

    name = "motion"

    def draw(self, dataset: Any, narrow: bool = False) -> Any:
        from clearance_jax.report.overview import draw_motion

        return draw_motion(dataset, narrow)


class Play(AbstractFigure):
    """When and where pins bear, their orbits at every station of their sleeves, and when flanks of gaps bear.

    **Arguments:** `dataset`, `narrow`: as `AbstractFigure.draw`; `edges`: the orbits at the sleeve's edges only.
    """

    name = "play"

    def draw(self, dataset: Any, narrow: bool = False, edges: bool = False) -> Any:
        from clearance_jax.report.play_figures import draw_play

        return draw_play(dataset, narrow, edges)


class PolarLoad(AbstractFigure):
    """From which direction, how hard and how long each pin is loaded after the first fall.

    The direction is that from the middle of the sleeve to the deepest contact, in the axes of the sleeve.

    **Arguments:** `dataset`, `narrow`: as `AbstractFigure.draw`.
    """

    name = "polar_load"

    def draw(self, dataset: Any, narrow: bool = False) -> Any:
        from clearance_jax.report.contact_figures import draw_polar_load

        return draw_polar_load(dataset, narrow)


class SpectrumFigure(AbstractFigure):
    """Power spectral densities of errors, contact forces and efforts of flanks after the first fall.

    They are Welch's, with Hann windows that overlap by half, at even times by linear interpolation.

    **Arguments:** `dataset`, `narrow`: as `AbstractFigure.draw`; `modes`: frequencies to be marked [Hz], such as
    `[mode.frequency for mode in cj.seated_modes(mechanism)]`.
    """

    name = "spectrum"

    def draw(self, dataset: Any, narrow: bool = False, modes: Any = ()) -> Any:
        from clearance_jax.report.contact_figures import draw_spectrum

        return draw_spectrum(dataset, narrow, tuple(modes))


class EpisodesFigure(AbstractFigure):
    """Impact speed, largest force and restitution of every contact episode over the time of its first touch.

    Gaps of drives, couplings and stops have columns of their own, with speeds and efforts in their units.

    **Arguments:** `dataset`, `narrow`: as `AbstractFigure.draw`.
    """

    name = "episodes"

    def draw(self, dataset: Any, narrow: bool = False) -> Any:
        from clearance_jax.report.contact_figures import draw_episodes

        return draw_episodes(dataset, narrow)


overview, motion, play = Overview(), MotionFigure(), Play()
polar_load, spectrum, episodes = PolarLoad(), SpectrumFigure(), EpisodesFigure()
KINDS = {kind.name: kind for kind in (overview, motion, play, polar_load, spectrum, episodes)}
# For the command's help.
LISTED = " ".join(f"{name}: {kind.__doc__.partition('.')[0]}." for name, kind in KINDS.items() if kind.__doc__)

__all__ = ["AbstractFigure", "episodes", "motion", "overview", "play", "polar_load", "spectrum"]


def kind_of(name: str) -> AbstractFigure:
    """The kind of figure of a name. **Raises** `ClearanceError` for an unknown one."""
    if name not in KINDS:
        raise unknown_name(f"There is no kind of figure `{name[:100]}`.", name, KINDS, "--plot-kind")
    return KINDS[name]


def save_figure(figure: Any, path: Any) -> None:
    """Write a figure. **Raises** `ClearanceError` where the path is not writable or its ending unknown."""
    from clearance_jax.results.store import whole_file

    fix = "Choose another path ending in .png or .pdf"
    with whole_file(path, "the figure ", fix, refused=(OSError, ValueError)) as partial:
        figure.savefig(partial, dpi=130)
