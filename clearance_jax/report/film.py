"""The base class of films: frames drawn on a figure one after another, and written to a file."""

import abc
import base64
from collections.abc import Callable, Iterator
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib.animation import FFMpegWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from clearance_jax.errors import ClearanceError
from clearance_jax.report.gif import write_gif

MOVIES = (".gif", ".mp4")
FPS, DPI = 20.0, 80
STYLE = {"font.size": 9, "axes.grid": False}


class AbstractFilm(abc.ABC):
    """A film: `len(film)` frames, `fps` of them a second; `show(k)` puts frame `k` on its `figure`; its `name`."""

    figure: Figure
    fps: float
    name: str

    @abc.abstractmethod
    def __len__(self) -> int: ...

    @abc.abstractmethod
    def show(self, k: int) -> Figure:
        """Draw frame `k`."""

    def settle(self) -> None:
        """Draw the first frame, and keep its layout for all frames."""
        self.show(0)
        self.figure.draw_without_rendering()
        self.figure.set_layout_engine("none")

    def __repr__(self) -> str:
        return f"Film of {self.name}: {len(self)} frames, {self.fps:.3g} a second"

    def save(self, path: str | Path, progress: Callable[[float], None] | None = None) -> Path:
        """Write a GIF, or an MP4 where the program ffmpeg is there; whole or not at all, interrupted too.

        **Arguments:** `progress`: called with the fraction done.

        **Raises:** `ClearanceError` for another ending, a path that is not writable, or without ffmpeg.
        """
        path = Path(path)
        check_movie(path)
        partial = path.with_name(f".partial.{path.name}")
        try:
            if path.suffix.lower() == ".gif":
                canvas = FigureCanvasAgg(self.figure)
                write_gif(partial, (_pixels(canvas) for _ in self._show(progress)), self.fps)
            else:
                writer = FFMpegWriter(fps=self.fps)
                with writer.saving(self.figure, str(partial), DPI):
                    for _ in self._show(progress):
                        writer.grab_frame()
            partial.replace(path)
        except OSError as error:
            raise ClearanceError(
                f"Cannot write the film `{path}`: {error.strerror or error}. Choose another path."
            ) from None
        finally:
            partial.unlink(missing_ok=True)
        return path

    def _show(self, progress: Callable[[float], None] | None) -> Iterator[int]:
        """Every frame, after one another, on the figure."""
        for k in range(len(self)):
            self.show(k)
            yield k
            if progress is not None:
                progress((k + 1) / len(self))

    def _repr_html_(self) -> str:
        """The film as a GIF, for a notebook."""
        with TemporaryDirectory() as folder:
            data = self.save(Path(folder) / "film.gif").read_bytes()
        return f'<img alt="{escape(self.name)}" src="data:image/gif;base64,{base64.b64encode(data).decode()}">'


def _pixels(canvas: FigureCanvasAgg) -> np.ndarray:
    canvas.draw()
    return np.array(canvas.buffer_rgba())


def check_movie(path: str | Path) -> None:
    """Raise if a film's format is unknown, or needs a program that is missing."""
    ending = Path(path).suffix.lower()
    if ending not in MOVIES:
        raise ClearanceError(f"Cannot write the film `{path}`: its name must end in {' or '.join(MOVIES)}.")
    if ending == ".mp4" and not FFMpegWriter.isAvailable():
        raise ClearanceError(
            f"Cannot write the film `{path}`: an .mp4 needs the program ffmpeg, which is not on the path. Install it, "
            "or choose a name ending in .gif."
        )
