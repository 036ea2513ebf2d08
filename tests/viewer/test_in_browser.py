"""The viewer in a browser without a screen: it plays, shows the dataset's places, opens joints, fits a phone."""

import numpy as np
import pytest
from browser import CHROMIUM, Browser
from motions import arm, crank

import clearance_jax as cj

pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium: `apt-get install chromium`"),
    pytest.mark.slow,
]
# The picture in the window, without the plots and the panel [px].
PICTURE = (slice(60, 400), slice(0, 900))


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    running = Browser(tmp_path_factory.mktemp("profile"))
    yield running
    running.close()


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pages")
    motions = {"crank": crank(), "arm": arm(101), "ideal": crank(play=False)}
    return {name: (motion, cj.view(motion).save(folder / f"{name}.html")) for name, motion in motions.items()}


@pytest.mark.parametrize("name", ["crank", "arm", "ideal"])
def test_it_plays(browser, pages, name):
    browser.open(pages[name][1])
    before = browser.picture()[PICTURE]
    assert len(np.unique(before.reshape(-1, 3), axis=0)) > 20
    browser.press(" ")
    browser.wait(f"viewer.playing && viewer.time > {float(pages[name][0]['time'][-1]) / 20}")
    browser.press(" ")
    after = browser.picture()[PICTURE]
    assert np.any(before != after, axis=-1).sum() > 300
    assert browser.evaluate("viewer.playing") is False
    assert browser.errors == []


@pytest.mark.parametrize("name", ["crank", "arm"])
@pytest.mark.parametrize("factor", [1.0, 50.0])
def test_places_in_the_scene_are_the_datasets(browser, pages, name, factor):
    dataset, path = pages[name]
    browser.open(path)
    browser.evaluate(f"viewer.setExaggeration({factor})")
    ideal, actual = (dataset[key].values for key in ("ideal_mark_position", "mark_position"))
    for row in (0, 40, 100):
        browser.evaluate(f"viewer.setTime({float(dataset['time'][row])!r})")
        seen = browser.evaluate("viewer.positions()")
        shown, still = (np.array(seen[key])[:, : ideal.shape[-1]] for key in ("shown", "ideal"))
        assert np.abs(still - ideal[row]).max() < 1e-7
        assert np.abs(shown - (ideal + factor * (actual - ideal))[row]).max() < 1e-7 + factor * 1e-8
    assert browser.errors == []


def test_a_click_on_a_joint_opens_it(browser, pages):
    browser.open(pages["crank"][1])
    browser.press("Escape")
    assert browser.evaluate("document.querySelectorAll('figure canvas').length") == 0
    browser.click(*browser.evaluate("viewer.jointOnPage('wrist')"))
    assert browser.evaluate("viewer.scene.joints[viewer.selected].name") == "wrist"
    assert browser.evaluate("document.querySelectorAll('figure canvas').length") == 2
    pixels = "c.getContext('2d').getImageData(0, 0, c.width, c.height).data"
    assert browser.evaluate(f"[...document.querySelectorAll('figure canvas')].every((c) => {pixels}.some((x) => x))")
    facts = browser.evaluate("document.querySelector('aside dl').innerText")
    assert "100 µm" in facts.replace("\xa0", " ")
    # So does the list, and keys.
    browser.press("n")
    assert browser.evaluate("viewer.scene.joints[viewer.selected].name") == "base"
    assert "no play" in browser.evaluate("document.querySelector('aside').innerText")


def test_plots_and_time_are_linked(browser, pages):
    dataset, path = pages["crank"]
    browser.open(path)
    left, top, width, height = browser.evaluate(
        "((r) => [r.left, r.top, r.width, r.height])(document.querySelector('.plots').getBoundingClientRect())"
    )
    before = browser.picture()
    browser.click(left + 0.5 * width, top + 0.3 * height)
    time = browser.evaluate("viewer.time")
    # 66 px on the left hold the numbers, 14 on the right are free.
    share = (0.5 * width - 66) / (width - 80)
    assert time == pytest.approx(share * float(dataset["time"][-1]), abs=float(dataset["time"][-1]) / 300)
    assert np.any(before != browser.picture())
    browser.press("ArrowRight")
    assert browser.evaluate("viewer.time") in dataset["time"].values


def test_errors_are_enlarged_by_keys_and_the_page_says_so(browser, pages):
    browser.open(pages["arm"][1])
    browser.press("1")
    assert "errors at true scale" in browser.evaluate("document.querySelector('.chips').innerText")
    small = browser.picture()[PICTURE]
    browser.evaluate("viewer.setExaggeration(500)")
    browser.drawn()
    assert "× 500" in browser.evaluate("document.querySelector('.chips').innerText")
    assert np.any(small != browser.picture()[PICTURE], axis=-1).sum() > 300


@pytest.mark.parametrize("name", ["crank", "arm", "ideal"])
def test_a_phone_shows_it_without_sideways_scrolling(browser, pages, name):
    browser.open(pages[name][1], width=390, height=844)
    assert browser.evaluate("document.documentElement.scrollWidth") <= 390
    parts = "[...document.querySelectorAll('#viewer :not(.names *)')]"
    assert (
        browser.evaluate(f"{parts}.filter((e) => e.getBoundingClientRect().right > 391).map((e) => e.className)") == []
    )
    assert browser.errors == []
