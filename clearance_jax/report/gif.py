"""Writes GIFs with one palette for all frames, which makes the file smaller than one palette each."""

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image
from scipy.spatial import KDTree

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
