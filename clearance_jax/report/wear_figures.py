"""Figures of a life of wear (`wear.to_dataset`): profiles, growth, the criterion; a film; maps along a sleeve."""

from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator

from clearance_jax.errors import ClearanceError
from clearance_jax.report.film import DPI, FPS, STYLE, AbstractFilm
from clearance_jax.report.magnified import EDGE, SHOWN, WALL, bushing, round_factor
from clearance_jax.report.style import BLUE, NARROW, RED, STYLED, legend_below, length_unit, new_figure
from clearance_jax.report.sweep_axes import display

# Number of ages whose profiles are drawn; frames of a film, and how many of them a second.
AGES, FRAMES, SLOW = 6, 80, FPS / 2
PALE, MARK = "0.75", RED


@STYLED
def overview(dataset: xr.Dataset, narrow: bool = False) -> Figure:
    """Four panels of the life of a joint: profiles over the angle, the bore magnified, growth over the cycles, and the
    number that was watched, or the volume.

    **Arguments:** `dataset`: of `wear.to_dataset`; `narrow`: panels below each other, for a screen of 390 pixels.

    **Raises:** `ClearanceError` for another dataset.
    """
    check(dataset)
    figure = Figure(figsize=(NARROW, 14.0) if narrow else (12, 7.5), layout="constrained")
    grid = figure.add_gridspec(4, 1) if narrow else figure.add_gridspec(2, 5)
    places = [grid[k, 0] for k in range(4)] if narrow else [grid[0, :3], grid[0, 3:], grid[1, :3], grid[1, 3:]]
    for draw, place in zip(
        (profiles, bore, growth, criterion if "watched" in dataset else volume), places, strict=True
    ):
        draw(figure.add_subplot(place), dataset)
    end = f", life {dataset.attrs['life']:.6g} cycles" if "life" in dataset.attrs else ""
    gap = "\n" if narrow else ": "
    figure.suptitle(f"{dataset.attrs.get('name', dataset.attrs['mechanism'])}{gap}joint {dataset.attrs['joint']}{end}")
    return figure


@STYLED
def intervals(dataset: xr.Dataset, name: str) -> Figure:
    """Life over a number that varies, the maintenance interval; `dataset`: of `ServiceLives.to_dataset`."""
    if name not in dataset or "life" not in dataset:
        raise ClearanceError(f"There is no life against `{name}` in this dataset.")
    order = np.argsort(dataset[name].values, kind="stable")
    told = display(dataset[name], name)
    x, y = told.factor * dataset[name].values[order], dataset["life"].values[order]
    figure, axis = new_figure(6.5, 4.0)
    draw_lives(axis, x, y, dataset.attrs["cycles"])
    if not np.isfinite(y).all():
        legend_below(axis, fontsize=8)
    axis.set(xlabel=f"{name}, {told.unit}" if told.unit else name, ylabel="life, cycles", ylim=(0, None))
    return figure


def draw_lives(axis: Any, x: np.ndarray, lives: np.ndarray, most: int, name: str = "") -> None:
    """Draw lives over a number; lives that have not ended are drawn at `most` cycles."""
    ended = np.isfinite(lives)
    (line,) = axis.plot(x[ended], lives[ended], "o-", ms=4, lw=1, label=name or "until the bound is met")
    if not ended.all():
        longer = f"more than {most} cycles" + (f" ({name})" if name else "")
        axis.plot(x[~ended], np.full(np.sum(~ended), most), "^", color=line.get_color(), label=longer)


@STYLED
def failures(found: Any) -> Figure:
    """The probability of failure over the life, with its confidence band (`wear.Failures`)."""
    figure, axis = new_figure(6.5, 4.0)
    band = f"{100 * found.confidence:g} % confidence"
    axis.fill_between(found.cycles, found.low, found.high, step="post", color=PALE, lw=0, label=band)
    axis.step(found.cycles, found.probability, where="post", lw=1.4, label="of the samples")
    axis.set(xlabel="cycles", ylabel="probability of failure", ylim=(0, 1), xlim=(0, None))
    legend_below(axis, fontsize=8)
    return figure


def check(dataset: xr.Dataset) -> None:
    """Raise `ClearanceError` for a dataset of another kind."""
    if not is_life(dataset):
        raise ClearanceError("There is nothing to draw: this is no result of a study of wear.")


def is_life(dataset: xr.Dataset) -> bool:
    """Whether a dataset is one of `wear.to_dataset`."""
    return "depth" in dataset and dataset["depth"].dims == ("cycle", "sector")


def profiles(axis: Any, dataset: xr.Dataset) -> None:
    """Depths over the angle at ages evenly over the life of a `dataset` (of `wear.to_dataset`), on an `axis`."""
    angle = np.degrees(dataset["angle"].values)
    factor, unit = length_unit(float(dataset["deepest"].max()))
    for age, colour in _ages(dataset):
        axis.plot(angle, factor * _depth(dataset, age), color=colour, lw=1.2, label=f"{age:.0f} cycles")
    axis.set(title="profile", xlabel="angle around the sleeve, deg", ylabel=f"depth of wear, {unit}")
    axis.set(xticks=np.arange(0, 361, 45), xlim=(0, 360), ylim=(0, None))
    legend_below(axis, fontsize=7)


def bore(axis: Any, dataset: xr.Dataset) -> None:
    """The bore at several ages around its pin, with clearance and wear magnified.

    **Arguments:** `axis`: matplotlib's axes to draw on; `dataset`: of `wear.to_dataset`.
    """
    radius, factors = float(dataset.attrs["pin_radius"]), _factors(dataset)
    for age, colour in _ages(dataset):
        axis.plot(*_bore(dataset, age, factors), color=colour, lw=1.2)
    axis.add_patch(Circle((0, 0), radius, fc="0.9", ec="0.5", lw=0.8))
    axis.set(aspect="equal", title=f"bore: {_magnification_words(factors)}")
    axis.set_axis_off()


def growth(axis: Any, dataset: xr.Dataset) -> None:
    """How depth and clearance grow over the cycles.

    **Arguments:** `axis`: matplotlib's axes to draw on; `dataset`: of `wear.to_dataset`.
    """
    clearance, (factor, unit) = dataset["radial_clearance"].values, length_unit(float(dataset["deepest"].max()))
    curves = {"largest depth": dataset["deepest"].values, "mean depth": dataset["mean_depth"].values}
    for name, values in {**curves, "radial clearance, grown by": clearance - clearance[0]}.items():
        axis.plot(dataset["cycle"].values, factor * values, "o-", ms=2.5, lw=1, label=name)
    axis.set(title="growth", ylabel=unit)
    _over_life(axis, dataset)
    legend_below(axis, fontsize=7)


def criterion(axis: Any, dataset: xr.Dataset) -> None:
    """The number that the end of the life watches, over the cycles, with its bound.

    **Arguments:** `axis`: matplotlib's axes to draw on; `dataset`: of `wear.to_dataset`.
    """
    watched = dataset["watched"]
    told = display(watched)
    axis.plot(dataset["cycle"], told.factor * watched, "o-", ms=2.5, lw=1)
    axis.axhline(told.factor * watched.attrs["bound"], color=MARK, lw=1, ls="--", label="bound")
    axis.set(title=told.name, ylabel=told.unit)
    _over_life(axis, dataset)
    legend_below(axis, fontsize=7)


def volume(axis: Any, dataset: xr.Dataset) -> None:
    """The volume worn off over the cycles.

    **Arguments:** `axis`: matplotlib's axes to draw on; `dataset`: of `wear.to_dataset`.
    """
    axis.plot(dataset["cycle"], 1e9 * dataset["volume"], "o-", ms=2.5, lw=1)
    axis.set(title="volume worn off", ylabel="mm³")
    _over_life(axis, dataset)


def _over_life(axis: Any, dataset: xr.Dataset) -> None:
    if "life" in dataset.attrs:
        axis.axvline(float(dataset.attrs["life"]), color=MARK, lw=1, label="end of life")
    axis.set_xlabel("cycles")
    axis.xaxis.set_major_locator(MaxNLocator(nbins=6))


def _last(dataset: xr.Dataset) -> float:
    """The age at which the life ends [cycles]; the last block may go beyond it."""
    return float(dataset.attrs.get("life", dataset["cycle"][-1]))


def _ages(dataset: xr.Dataset) -> list[tuple[float, Any]]:
    ages = np.linspace(0.0, _last(dataset), AGES)
    return list(zip(ages, mpl.colormaps["viridis"](np.linspace(0.9, 0.0, AGES)), strict=True))


def _depth(dataset: xr.Dataset, age: float) -> np.ndarray:
    """Depths at an age [m], (sectors,), between blocks by interpolation."""
    return np.array([np.interp(age, dataset["cycle"].values, depths) for depths in dataset["depth"].values.T])


def _factors(dataset: xr.Dataset) -> tuple[float, float]:
    """Magnifications of clearance and wear: equal, or a larger one for wear so that it is visible."""
    reach = SHOWN * float(dataset.attrs["pin_radius"])
    gap = round_factor(reach / float(dataset.attrs["unworn_clearance"]))
    return gap, max(gap, round_factor(reach / max(float(dataset["deepest"].max()), 1e-12)))


def _magnification_words(factors: tuple[float, float]) -> str:
    gap, worn = (f"{factor:.0f}" for factor in factors)
    return f"clearance and wear × {gap}" if gap == worn else f"clearance × {gap}, wear × {worn}"


def _bore(dataset: xr.Dataset, age: float, factors: tuple[float, float]) -> np.ndarray:
    """The outline of the bore, (2, sectors + 1), closed."""
    angle, depth = dataset["angle"].values, _depth(dataset, age)
    radius, clearance = float(dataset.attrs["pin_radius"]), float(dataset.attrs["unworn_clearance"])
    outline = (radius + factors[0] * clearance + factors[1] * depth) * np.stack([np.cos(angle), np.sin(angle)])
    return np.concatenate([outline, outline[:, :1]], axis=1)


class WearFilm(AbstractFilm):
    """A film of the wear of a sleeve over its life: the bore magnified, depths over the angle, and how they have grown.

    **Arguments:** `dataset`: of `wear.to_dataset`; `frames`: how many; `fps`: how many of them a second.
    """

    def __init__(self, dataset: xr.Dataset, frames: int, fps: float):
        check(dataset)
        self.dataset, self.fps, self.name = dataset, fps, str(dataset.attrs.get("name", dataset.attrs["joint"]))
        self.ages = np.linspace(0.0, _last(dataset), frames)
        self._factors, (self._micro, unit) = _factors(dataset), length_unit(float(dataset["deepest"].max()))
        with mpl.rc_context(STYLE):
            self.figure = Figure(figsize=(9, 5), dpi=DPI, layout="constrained")
            parts: Any = self.figure.subfigures(1, 2, width_ratios=(1.0, 1.1))
            left, right = parts
            ring, radius, new = left.subplots(), float(dataset.attrs["pin_radius"]), self._outline(0.0)
            far = float(np.hypot(*self._outline(_last(dataset))).max()) + WALL * radius
            self._wall, _ = bushing(ring, new, radius, far)
            ring.plot(*new, color=EDGE, lw=0.8, ls="--")
            ring.set_title(_magnification_words(self._factors), fontsize=9)
            upper, lower = right.subplots(2, 1)
            angle, last = np.degrees(dataset["angle"].values), _depth(dataset, _last(dataset))
            upper.plot(angle, self._micro * last, color=PALE, lw=1)
            upper.set(xlabel="angle around the sleeve, deg", ylabel=f"depth, {unit}")
            upper.set(xticks=np.arange(0, 361, 90), xlim=(0, 360), ylim=(0, None))
            self._curve = upper.plot(angle, 0 * last, color=BLUE, lw=1.2)[0]
            growth(lower, dataset)
            self._cursor = lower.axvline(0.0, color="k", lw=1.2)
            self._clock = self.figure.suptitle("", fontsize=11)
            self.settle()

    def __len__(self) -> int:
        return len(self.ages)

    def show(self, k: int) -> Figure:
        """Draw frame `k`."""
        age = float(self.ages[k])
        self._wall.set_xy(self._outline(age).T)
        self._curve.set_ydata(self._micro * _depth(self.dataset, age))
        self._cursor.set_xdata([age, age])
        self._clock.set_text(f"{self.name}   {age:.0f} cycles")
        return self.figure

    def _outline(self, age: float) -> np.ndarray:
        return _bore(self.dataset, age, self._factors)


def animate(dataset: xr.Dataset, *, frames: int = FRAMES, fps: float = SLOW) -> WearFilm:
    """A film of the wear of a sleeve over its life, in even steps of cycles: `film.save("wear.gif")`.

    **Arguments:** `dataset`: of `wear.to_dataset`; `frames`: how many, at least 2; `fps`: how many of them a second, >
    0.

    **Raises:** `ClearanceError` for another dataset, and for other numbers.
    """
    if frames < 2 or not (np.isfinite(fps) and fps > 0):
        text = f"A film has at least 2 frames, and more than 0 a second, but not {frames} and {fps:g}."
        raise ClearanceError(text).about("frames", frames)
    return WearFilm(dataset, frames, fps)


def wear_map(worn: Any, title: str = "") -> Figure:
    """A map of depths over the angle and along the sleeve, and beside it the deepest of every height.

    **Arguments:** `worn`: what has worn off (`wear.Wear`), with `angle` [rad], `heights` [m] and `depth` [m] of every
    height and angle.

    **Raises:** `ClearanceError` for wear of a joint in the plane, which is the same all along it.
    """
    angle, heights, depth = (np.asarray(x) for x in (worn.angle, worn.heights, worn.depth))
    if len(heights) < 2:
        raise ClearanceError("A wear map needs a joint with stations along its sleeve, but this one wears evenly.")
    factor, unit = length_unit(float(depth.max()))
    # A station's strip ends halfway to the next.
    edges = 1e3 * np.concatenate([heights[:1], 0.5 * (heights[1:] + heights[:-1]), heights[-1:]])
    across = np.degrees(np.append(angle, 2 * np.pi) - 0.5 * (angle[1] - angle[0]))
    with mpl.rc_context({"font.size": 9}):
        figure = Figure(figsize=(8.5, 3.2), layout="constrained")
        field, beside = figure.subplots(1, 2, sharey=True, width_ratios=(4, 1))
        drawn = field.pcolormesh(across, edges, factor * depth, cmap="inferno_r", vmin=0.0)
        field.set(xlabel="angle, deg", ylabel="height along the sleeve, mm", xticks=range(0, 361, 45), title=title)
        figure.colorbar(drawn, ax=field, label=f"depth of wear, {unit}")
        beside.plot(factor * depth.max(axis=1), 1e3 * heights, "o-", ms=3, lw=0.8)
        beside.set(xlabel=f"deepest, {unit}", xlim=(0, None))
        beside.grid(alpha=0.3)
    return figure


__all__ = ["WearFilm", "animate", "bore", "criterion", "growth", "overview", "profiles", "volume"]
