"""Figures of a motion, by name: `cj.figures.overview(dataset)`, or `clearance plot RESULT --plot-kind overview`.

A kind of figure is a class here, which the command's help and errors read. What draws it is imported when it draws.
"""

import abc
from pathlib import Path
from typing import Any, ClassVar

from clearance_jax.errors import ClearanceError, unknown_name


class AbstractFigure(abc.ABC):
    """A kind of figure of a motion: its `name`, and what it shows, `about`, in one line for the command's help."""

    name: ClassVar[str]
    about: ClassVar[str]

    @abc.abstractmethod
    def draw(self, dataset: Any, narrow: bool = False) -> Any:
        """The matplotlib `Figure` of a dataset.

        **Arguments:** `dataset`: of `to_dataset`; `narrow`: panels below each other, for a screen of 390 pixels.

        **Raises:** `ClearanceError` for a dataset that has nothing to show.
        """


class Overview(AbstractFigure):
    """The default figure."""

    name = "overview"
    about = "mechanism, error, contact forces apart from the first fall, eccentricity, orbits of pins"

    def draw(self, dataset: Any, narrow: bool = False) -> Any:
        """The mechanism, the error of its points against the ideal mechanism, contact forces after the first fall of
        the pins and in it, eccentricities, when pins bear, and their orbits; of many joints those that bear most.
        Without play: as `motion`.

        **Arguments:** `dataset`: of `to_dataset`; `narrow`: panels below each other, for a screen of 390 pixels.

        **Raises:** `ClearanceError` for a dataset that is no motion, or shows nothing.
        """
        from clearance_jax.report.overview import draw_overview

        return draw_overview(dataset, narrow)


class MotionFigure(AbstractFigure):
    """How the mechanism moves."""

    name = "motion"
    about = "coordinates, speeds and accelerations of points, drives or reactions, paths"

    def draw(self, dataset: Any, narrow: bool = False) -> Any:
        """Coordinates, speeds and accelerations of the named points, efforts of drives and actuators or (where there
        are none) reactions in joints, and the points' paths.

        **Arguments:** `dataset`: of `to_dataset`; `narrow`: panels below each other, for a screen of 390 pixels.

        **Raises:** `ClearanceError` for a dataset that is no motion, or shows nothing.
        """
        from clearance_jax.report.overview import draw_motion

        return draw_motion(dataset, narrow)


class Play(AbstractFigure):
    """Where pins bear."""

    name = "play"
    about = "when and where pins bear, and their orbits at every station of their sleeves"

    def draw(self, dataset: Any, narrow: bool = False, edges: bool = False) -> Any:
        """The contact patterns of clearance joints over time, and below them the orbits of pins at every station of
        their sleeves (of the joints with the largest forces).

        **Arguments:** `dataset`: of `to_dataset`; `narrow`: panels below each other, for a screen of 390 pixels;
        `edges`: the orbits at the sleeve's edges only.

        **Raises:** `ClearanceError` for a dataset without clearance joints.
        """
        from clearance_jax.report.play_figures import draw_play

        return draw_play(dataset, narrow, edges)


class PolarLoad(AbstractFigure):
    """Polar load diagrams."""

    name = "polar_load"
    about = "polar load diagrams: from where, how hard and how long each pin is loaded"

    def draw(self, dataset: Any, narrow: bool = False) -> Any:
        """Of each pin, after its first fall, the contact force over its direction in the sleeve's axes, and the share
        of the time in which it bears in each direction. The direction is that of the deepest contact: from the middle
        of the sleeve to the wall.

        **Arguments:** `dataset`: of `to_dataset`; `narrow`: panels below each other, for a screen of 390 pixels.

        **Raises:** `ClearanceError` for a dataset without a pin in a sleeve.
        """
        from clearance_jax.report.contact_figures import draw_polar_load

        return draw_polar_load(dataset, narrow)


class SpectrumFigure(AbstractFigure):
    """Spectra of error and force."""

    name = "spectrum"
    about = "spectra of the errors and the contact forces after the first fall"

    def draw(self, dataset: Any, narrow: bool = False, modes: Any = ()) -> Any:
        """Power spectral densities (Welch, Hann windows that overlap by half) of the points' errors and the joints'
        contact forces after the first fall, sampled evenly by linear interpolation. The title states the resolution.

        **Arguments:** `dataset`: of `to_dataset`; `narrow`: panels below each other, for a screen of 390 pixels;
        `modes`: frequencies to be marked [Hz], such as `[mode.frequency for mode in cj.seated_modes(mechanism)]`.

        **Raises:** `ClearanceError` for a dataset without play, or with less than 64 samples after the first fall.
        """
        from clearance_jax.report.contact_figures import draw_spectrum

        return draw_spectrum(dataset, narrow, modes)


class EpisodesFigure(AbstractFigure):
    """Contact episodes over time."""

    name = "episodes"
    about = "impact speed, largest force and restitution of every contact episode"

    def draw(self, dataset: Any, narrow: bool = False) -> Any:
        """Impact speed, largest force and restitution of every contact episode over the time of its first touch;
        episodes of the first fall are hollow.

        **Arguments:** `dataset`: of `to_dataset` for a `Trace`; `narrow`: for a screen of 390 pixels.

        **Raises:** `ClearanceError` for a dataset without contact episodes.
        """
        from clearance_jax.report.contact_figures import draw_episodes

        return draw_episodes(dataset, narrow)


KINDS: dict[str, AbstractFigure] = {
    kind.name: kind
    for kind in (Overview(), MotionFigure(), Play(), PolarLoad(), SpectrumFigure(), EpisodesFigure())
}  # fmt: skip
# For the command's help.
LISTED = "; ".join(f"{name}: {kind.about}" for name, kind in KINDS.items())

overview, motion, play = Overview().draw, MotionFigure().draw, Play().draw
polar_load, spectrum, episodes = PolarLoad().draw, SpectrumFigure().draw, EpisodesFigure().draw

__all__ = ["AbstractFigure", "episodes", "motion", "overview", "play", "polar_load", "spectrum"]


def kind_of(name: str) -> AbstractFigure:
    """The kind of figure of a name. **Raises** `ClearanceError` for an unknown one."""
    if name not in KINDS:
        raise unknown_name(f"There is no kind of figure `{name[:100]}`.", name, KINDS, "--plot-kind")
    return KINDS[name]


def save_figure(figure: Any, path: Any) -> None:
    """Write a figure. **Raises** `ClearanceError` where the path is not writable or its ending unknown."""
    path = Path(path)
    partial = path.with_name(f".partial.{path.name}")
    try:
        figure.savefig(partial, dpi=130)
        partial.replace(path)
    except (OSError, ValueError) as error:
        partial.unlink(missing_ok=True)
        fix = "Choose another path ending in .png or .pdf."
        raise ClearanceError(f"Cannot write the figure `{path}`: {error}. {fix}") from error
