"""Whether everything that is written in a figure can be read: nothing is cut off, and nothing hides something else."""

import re
from typing import Any

from matplotlib.legend import Legend
from matplotlib.text import Text
from mpl_toolkits.mplot3d.art3d import Text3D

# Numbers of ticks: those outside of the view of their axis are not drawn.
TICKS = re.compile(r"[−\d.,°]+|\$\\mathdefault\{[^a-z]*\}\$")
# Texts of at least so many letters must not overlap; how far a text may leave the page [pixel].
WORD, HAIR = 5, 1.0


def check_texts(figure: Any) -> None:
    """Assert that no text and no legend leaves the figure, and that no two texts of some length overlap."""
    figure.draw_without_rendering()
    page, boxes = figure.bbox, {}
    for text in figure.findobj(Text):
        words = text.get_text().strip()
        # Of a text in space matplotlib knows the place on the page only while it draws.
        if text.get_visible() and words and not TICKS.fullmatch(words) and not isinstance(text, Text3D):
            box = boxes[id(text)] = text.get_window_extent()
            assert page.x0 - HAIR <= box.x0 <= box.x1 <= page.x1 + HAIR, words
            assert page.y0 - HAIR <= box.y0 <= box.y1 <= page.y1 + HAIR, words
    told = [(text.get_text(), boxes[id(text)]) for text in {id(t): t for t in figure.findobj(Text)}.values()
            if id(text) in boxes and len(text.get_text().strip()) >= WORD]  # fmt: skip
    for k, (words, box) in enumerate(told):
        for others, its in told[k + 1 :]:
            assert not box.overlaps(its), (words, others)
    for legend in figure.findobj(Legend):
        box = legend.get_window_extent()
        assert page.x0 - HAIR <= box.x0 <= box.x1 <= page.x1 + HAIR, legend.get_texts()[0].get_text()
        assert page.y0 - HAIR <= box.y0 <= box.y1 <= page.y1 + HAIR, legend.get_texts()[0].get_text()
