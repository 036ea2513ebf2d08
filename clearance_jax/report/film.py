"""The base class of films: frames drawn on a figure one after another, and written to a file."""

import abc
import base64
from collections.abc import Callable, Iterable, Iterator
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from matplotlib.animation import FFMpegWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image
from scipy.spatial import KDTree

from clearance_jax.errors import ClearanceError

MOVIES = (".gif", ".mp4")
FPS, DPI = 20.0, 80
STYLE = {"font.size": 9, "axes.grid": False}
# Colours of a GIF (the last of 256 marks pixels that stay as they were, which makes the file smaller), and in how many
# frames they are looked for.
COLOURS, LOOKED_AT = 255, 10
_BITS = np.array([1 << 16, 1 << 8, 1])


class GifFrame(NamedTuple):
    """A picture: its `colours`, packed to one number each, and `which` of them every pixel has, (height, width)."""

    colours: np.ndarray
    which: np.ndarray


def write_gif(path: str | Path, pictures: Iterable[np.ndarray], fps: float) -> None:
    """Write pictures (height, width, 3 or 4), of bytes each, as a GIF that repeats."""
    frames = [_frame(picture) for picture in pictures]
    palette = _palette(frames[:: -(-len(frames) // LOOKED_AT)])
    first, *rest = (_paint(frame, palette) for frame in frames)
    lasts = max(round(1000 / fps), 20)  # ms; what is shorter browsers show slowly
    first.save(path, format="GIF", save_all=True, append_images=rest, duration=lasts, loop=0)


def _frame(picture: np.ndarray) -> GifFrame:
    colours, which = np.unique(picture[..., :3] @ _BITS, return_inverse=True)
    return GifFrame(colours, which.reshape(picture.shape[:2]).astype(np.min_scalar_type(len(colours))))


def _palette(frames: list[GifFrame]) -> np.ndarray:
    """The colours that most of the pixels have: areas keep theirs, their blurred edges get the nearest."""
    seen = np.concatenate([frame.colours for frame in frames])
    counts = np.concatenate([np.bincount(frame.which.ravel()) for frame in frames])
    colours, which = np.unique(seen, return_inverse=True)
    totals = np.bincount(which, counts)
    return _parts(colours[np.argsort(-totals, kind="stable")[:COLOURS]])


def _paint(frame: GifFrame, palette: np.ndarray) -> Image.Image:
    """A frame in the nearest colours of a palette. (Pillow's own choice turns white into a light grey.)"""
    near = np.asarray(KDTree(palette).query(_parts(frame.colours))[1]).astype(np.uint8)
    painted = Image.fromarray(near[frame.which])
    painted.putpalette(palette.astype(np.uint8).tobytes())
    return painted


def _parts(colours: np.ndarray) -> np.ndarray:
    """Red, green and blue, (colours, 3)."""
    return colours[:, None] // _BITS % 256


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
