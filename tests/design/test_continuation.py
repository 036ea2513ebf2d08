"""Designs by way of smoothed laws: the answer is that of the laws themselves."""

import pytest
from catalogue import slider_crank
from places import refused

from clearance_jax import design, laws, metrics

NAME = "wrist.radial_clearance"
WIDTHS = (1e-6, 1e-7, 0)


def problem():
    limit = design.Limit(metrics.Peak(metrics.PositionError("piston")), 1e-4, "piston")
    return design.ToleranceProblem(slider_crank(), 1e-3, {NAME: (1e-5, 1e-3)}, [limit])


def normal(found):
    """The normal law by which a design was judged."""
    (joint,) = found.specification.mechanism.clearance_joints()
    return joint.clearance.normal


@pytest.mark.slow
def test_the_answer_is_that_of_the_law_itself(tmp_path):
    record = tmp_path / "points.jsonl"
    direct, by_way = problem().solve(), problem().solve(smoothing=WIDTHS, record=record)
    assert by_way.clearances[NAME] == pytest.approx(direct.clearances[NAME], rel=1e-6)
    assert by_way.feasible
    assert by_way.active == direct.active == ["piston: position error, peak 1"]
    # The last search judges by the law itself, and has next to nothing left to do.
    assert [width for width, _ in by_way.before] == [1e-6, 1e-7]
    assert isinstance(normal(by_way), laws.AdamsImpact)
    for width, found in by_way.before:
        own = normal(found)
        assert isinstance(own, laws.SmoothedOnset)
        assert float(own.width) == width
    solves = [found.program.solves for _, found in by_way.before] + [by_way.program.solves]
    assert solves[0] <= direct.program.solves + 1
    assert max(solves[1:]) <= 3
    assert str(by_way).count("before, with laws smoothed over") == 2
    # Each width has its record, from which it goes on.
    again = problem().solve(smoothing=WIDTHS, record=record)
    assert [found.program.solves for _, found in again.before] + [again.program.solves] == [0, 0, 0]
    assert again.clearances == by_way.clearances


@pytest.mark.slow
def test_an_interrupted_search_says_whose_design_it_has():
    def stop(point):
        raise KeyboardInterrupt

    found = problem().solve(smoothing=WIDTHS, progress=stop)
    assert found.stop_reason == "interrupted"
    assert "a design of laws that are smoothed over 1e-06 m, not of the laws themselves" in str(found)


@pytest.mark.parametrize("widths", [(), (1e-6,), (1e-7, 1e-6, 0), (1e-6, -1e-7, 0), (float("inf"), 0), (1e-6, 1e-6, 0)])
def test_widths_have_to_fall_to_zero(widths):
    with refused("smoothing", str(tuple(map(float, widths)))):
        problem().solve(smoothing=widths)


def test_classes_are_chosen_afterwards():
    with refused("classes"):
        problem().solve(smoothing=WIDTHS, classes={NAME: ["H7/g6"]})
