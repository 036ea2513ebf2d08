"""Films: frames drawn on a figure one after another, and written to a file; and those of a motion from a dataset: the
mechanism, beside it a magnified clearance joint, below it the joint's contact force and state over time. Without play
in joints the place in the gap of a drive, or between stops, is below it.
"""

import abc
import base64
from collections.abc import Callable, Iterable, Iterator
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.animation import FFMpegWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image
from scipy.spatial import KDTree

from clearance_jax.errors import ClearanceError, wrong_value
from clearance_jax.report.magnified import CrossSection, Side, magnify
from clearance_jax.report.panels import SHORT, curve, gap_places, half_gap, time_axis
from clearance_jax.report.play_figures import timeline
from clearance_jax.report.skeleton import Skeleton
from clearance_jax.report.style import RED, round_down
from clearance_jax.report.style import STYLE as LOOK
from clearance_jax.results.places import names_of, places
from clearance_jax.results.play import JointPlay, require_joint
from clearance_jax.results.store import whole_file

MOVIES = (".gif", ".mp4")
FPS, DPI = 20.0, 80
STYLE = LOOK | {"axes.grid": False}
# Colours of a GIF (of 256 the last marks pixels that do not change, which makes the file smaller), those of them chosen
# because they are frequent, and the number of frames from which they are chosen.
COLOURS, FREQUENT, LOOKED_AT = 255, 192, 10
_BITS = np.array([1 << 16, 1 << 8, 1])
# Default length of a film [s]. It is slowed by a round factor that makes it no longer.
LASTS = 10.0


def write_gif(path: str | Path, pictures: Iterable[np.ndarray], fps: float) -> None:
    """Write pictures (height, width, 3 or 4), of bytes each, as a GIF that repeats."""
    frames = []  # colours, packed to one number each, and which of them every pixel has, (height, width)
    for picture in pictures:
        colours, which = np.unique(picture[..., :3] @ _BITS, return_inverse=True)
        which = which.reshape(picture.shape[:2]).astype(np.min_scalar_type(len(colours)))
        frames.append((colours, which))
    palette = _palette(frames[:: -(-len(frames) // LOOKED_AT)])
    first, *rest = (_paint(colours, which, palette) for colours, which in frames)
    lasts = max(round(1000 / fps), 20)  # ms; what is shorter browsers show slowly
    first.save(path, format="GIF", save_all=True, append_images=rest, duration=lasts, loop=0)


def _palette(frames: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """The most frequent colours, so that areas keep theirs; of those on blurred edges the ones farthest from all."""
    seen = np.concatenate([colours for colours, _ in frames])
    counts = np.concatenate([np.bincount(which.ravel()) for _, which in frames])
    colours, which = np.unique(seen, return_inverse=True)
    totals = np.bincount(which, counts)
    every = _parts(colours)
    chosen = list(np.argsort(-totals, kind="stable")[:FREQUENT])
    away = np.asarray(KDTree(every[chosen]).query(every)[0])
    while len(chosen) < min(COLOURS, len(colours)):
        chosen.append(np.argmax(away))
        away = np.minimum(away, np.linalg.norm(every - every[chosen[-1]], axis=1))
    return every[chosen]


def _paint(colours: np.ndarray, which: np.ndarray, palette: np.ndarray) -> Image.Image:
    """A frame in the nearest colours of a palette. (Pillow's own choice turns white into a light grey.)"""
    near = np.asarray(KDTree(palette).query(_parts(colours))[1]).astype(np.uint8)
    painted = Image.fromarray(near[which])
    painted.putpalette(palette.astype(np.uint8).tobytes())
    return painted


def _parts(colours: np.ndarray) -> np.ndarray:
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
        """Write a GIF, or with the program ffmpeg an MP4. It is written completely or not at all, if interrupted too.

        **Arguments:** `progress`: called with the fraction done.

        **Raises:** `ClearanceError` for another ending, a path that is not writable, or without ffmpeg.
        """
        path = Path(path)
        check_movie(path)
        with whole_file(path, "the film ") as partial:
            if path.suffix.lower() == ".gif":
                canvas = FigureCanvasAgg(self.figure)
                write_gif(partial, (_pixels(canvas) for _ in self._show(progress)), self.fps)
            else:
                writer = FFMpegWriter(fps=self.fps)
                with writer.saving(self.figure, str(partial), DPI):
                    for _ in self._show(progress):
                        writer.grab_frame()
        return path

    def _show(self, progress: Callable[[float], None] | None) -> Iterator[int]:
        for k in range(len(self)):
            self.show(k)
            yield k
            if progress is not None:
                progress((k + 1) / len(self))

    def _repr_html_(self) -> str:
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


class Film(AbstractFilm):
    """A film of the samples of a `dataset`. Make one with `cj.animate`.

    - `figure`: what is drawn on; `show(k)` puts frame `k` on it.
    - `frames` (frames,): indices of the samples that it shows; `fps`: how many of them a second.
    - `slowdown`: seconds of the film per second of the motion.
    - `exaggeration`: the factor by which the play of `joint` is magnified. The argument `factor` sets it.
    """

    def __init__(
        self, dataset: xr.Dataset, joint: str | None, frames: np.ndarray, fps: float, slowdown: float, factor: Any
    ):
        gaps = _loose_gaps(dataset)
        self._gap = joint if joint in gaps else next(iter(gaps), None)
        joint = None if joint in gaps else joint
        self.frames, self.fps, self.slowdown, self.joint = frames, fps, slowdown, joint
        self.time, self.name = dataset["time"].values, str(dataset.attrs.get("mechanism", ""))
        enlarged = None if joint is None else magnify(dataset, joint, factor)
        self.exaggeration = 1.0 if enlarged is None else enlarged.factor
        with mpl.rc_context(STYLE):
            self.figure = Figure(figsize=(11, 6.2) if enlarged is not None else (7, 6), dpi=DPI, layout="constrained")
            self._views, self._cursors = self._lay_out(dataset, enlarged)
            self._clock = self.figure.suptitle("", fontsize=11)
            self.settle()

    def __len__(self) -> int:
        return len(self.frames)

    def show(self, k: int) -> Figure:
        """Draw frame `k`."""
        i = int(self.frames[k])
        for view in self._views:
            view.show(i)
        factor, unit = (1e3, "ms") if self.time[-1] < SHORT else (1.0, "s")
        now = factor * self.time[i]
        for cursor in self._cursors:
            cursor.set_xdata([now, now])
        speed = f"slowed {self.slowdown:g} times" if self.slowdown >= 1 else f"{1 / self.slowdown:g} times as fast"
        # So many decimals that it shows a thousandth of the whole.
        digits = int(np.clip(3 - np.floor(np.log10(factor * self.time[-1])), 0, 6))
        self._clock.set_text(f"{self.name}   t = {now:.{digits}f} {unit}, {speed}")
        return self.figure

    def __repr__(self) -> str:
        of = f", {self.joint} with its play x {self.exaggeration:g}" if self.joint else ""
        return f"Film of {self.name}{of}: {len(self)} frames, {self.fps:.3g} a second"

    def _lay_out(self, dataset: xr.Dataset, enlarged: JointPlay | None) -> tuple[list, list]:
        """Draw what does not move; returns the views that follow the motion, and the cursors on time axes."""
        projection = "3d" if dataset.sizes["axis"] == 3 else None
        if enlarged is None:
            gap = self._gap
            heights = (4.6,) if gap is None else (4.6, 1.6)
            parts: Any = self.figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)
            view = Skeleton(parts[0, 0].add_subplot(projection=projection), places(dataset))
            return [view], [] if gap is None else [_in_gap(parts[1, 0].subplots(), dataset, gap)]
        parts = self.figure.subfigures(2, 1, height_ratios=(4.6, 1.6))
        upper, lower = parts
        left, right = upper.subfigures(1, 2, width_ratios=(1.1, 1.0))
        skeleton = Skeleton(left.add_subplot(projection=projection), places(dataset), self.joint)
        size = f"{1e6 * enlarged.outline.clearance:g} µm"
        known = f"{size} to either side" if enlarged.outline.height is not None else f"dashed: clearance {size}"
        title = f"{self.joint}: play × {enlarged.factor:g} ({known})"
        views = [skeleton, *_views(right, enlarged)]
        right.suptitle(title, color=RED, fontsize=10)
        force, bar = lower.subplots(2, 1, sharex=True, height_ratios=(2, 1))
        factor = time_axis(bar, float(self.time[-1]))
        curve(force, factor * self.time, dataset["contact_force"].sel(joint=self.joint).values, "")
        force.set(ylabel="contact\nforce, N", ylim=(0, None))
        force.grid(alpha=0.3)
        timeline(bar, dataset, [str(self.joint)])
        return views, [axis.axvline(0.0, color="k", lw=1.2, zorder=9) for axis in (force, bar)]


def _loose_gaps(dataset: xr.Dataset) -> list[str]:
    """The gaps that have a width, first that whose place changes most against it."""
    loose = [gap for gap in names_of(dataset, "gap") if not np.isnan(half_gap(dataset, gap))]
    sizes = {gap: float(np.ptp(dataset["gap_position"].sel(gap=gap).values)) / half_gap(dataset, gap) for gap in loose}
    return sorted(loose, key=lambda gap: -sizes[gap])


def _in_gap(axis: Any, dataset: xr.Dataset, gap: str) -> Any:
    """Draw the place in a gap over time; returns its cursor."""
    gap_places([gap], str(dataset["gap_unit"].sel(gap=gap).values), axis, dataset)
    where = "in the gap (dashed: its ends)" if f"gap.{gap}" in dataset.attrs else "between the stops (dashed)"
    axis.set_title(f"{gap}: place {where}", color=RED, fontsize=10)
    return axis.axvline(0.0, color="k", lw=1.2, zorder=9)


def _views(figure: Any, joint: JointPlay) -> list:
    """One section of a pin without tilt, two of a ball, ends and sides of a sleeve, the sides of a block."""
    outline = joint.outline
    if outline.height is not None:
        ways = "xy" if outline.width is not None else "x"
        axes = figure.subplots(len(ways), 1, squeeze=False)[:, 0]
        return [Side(_title(axes[up], f"along the guide, {way} up"), joint, up) for up, way in enumerate(ways)]
    if outline.length is not None:
        sides, ends = figure.subplots(2, 2)
        views: list = [Side(_title(axis, f"from the side, {'xy'[up]} up"), joint, up) for up, axis in enumerate(sides)]
        for axis, station in zip(ends, (0, -1), strict=True):
            place = f"{1e3 * outline.heights[station]:+.3g} mm".replace("-", "−")
            views.append(CrossSection(_title(axis, f"across the edge at z = {place}"), joint, station))
        return views
    if outline.ball:
        pairs = zip(figure.subplots(1, 2), ((0, 1), (0, 2)), strict=True)
        return [CrossSection(_title(axis, f"seen along {'zy'[pair[1] - 1]}"), joint, axes=pair) for axis, pair in pairs]
    return [CrossSection(figure.subplots(), joint)]


def _title(axis: Any, title: str) -> Any:
    axis.set_title(title, fontsize=9)
    return axis


def animate(
    dataset: xr.Dataset,
    joint: str | None = None,
    *,
    slowdown: float | None = None,
    exaggeration: float | None = None,
    span: tuple[float, float] | None = None,
    fps: float = FPS,
) -> Film:
    """A film of a motion, with a clearance joint magnified beside the mechanism: `film.save("play.gif")`. A notebook
    shows it by itself.

    **Arguments:**

    - `dataset`: of `to_dataset`. A film shows its samples, and nothing between them.
    - `joint`: the joint to magnify; by default the one with the largest force. Or the gap of a drive or of gears, or
      the stops, whose place is drawn over time; without play in joints by default the one that is crossed most.
    - `slowdown`: seconds of film per second of motion, > 0; by default so large that the film lasts ten seconds at
      most.
    - `exaggeration`: how many times as large the play is drawn, >= 1, beside a pin of its own size; by default so large
      that you see it.
    - `span`: from when to when [s]; by default all.
    - `fps`: frames a second, > 0; fewer if the dataset has fewer samples.

    **Raises:** `ClearanceError` for a joint that is not there or cannot be drawn, and for other numbers.
    """
    for name, value, least in (("slowdown", slowdown, 0.0), ("exaggeration", exaggeration, 1.0), ("fps", fps, 0.0)):
        if value is not None and not (np.isfinite(value) and value > 0 and value >= least):
            bound = "at least 1" if least else "greater than 0"
            raise wrong_value(f"`{name}`", bound, value, shown=f"{value:g}")
    if "time" not in dataset.coords:
        raise ClearanceError("There is nothing to film: this is no result of a simulation.")
    name = joint if joint is None or joint in _loose_gaps(dataset) else require_joint(dataset, joint)
    if joint is None and "contact_force" in dataset:
        name = str(dataset["joint"].values[int(dataset["contact_force"].values.mean(axis=0).argmax())])
    chosen = _within(dataset["time"].values, span)
    lasts = float(np.ptp(dataset["time"].values[chosen]))
    slowdown = slowdown or round_down(LASTS / lasts)
    count = min(round(slowdown * lasts * fps) + 1, len(chosen))
    frames = chosen[np.round(np.linspace(0, len(chosen) - 1, max(count, 2))).astype(int)]
    return Film(dataset, name, frames, (len(frames) - 1) / (slowdown * lasts), slowdown, exaggeration)


def _within(time: np.ndarray, span: tuple[float, float] | None) -> np.ndarray:
    first, last = (time[0], time[-1]) if span is None else span
    chosen = np.flatnonzero((time >= first) & (time <= last))
    if len(chosen) < 2:
        raise ClearanceError(
            f"A film needs two samples at least, but from {first:g} s to {last:g} s there are {len(chosen)}. "
            f"The result has {len(time)}, from {time[0]:g} s to {time[-1]:g} s."
        ).about("span", len(chosen))
    return chosen
