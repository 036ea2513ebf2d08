"""The reproduced paper: its statistics on signals that are known, its runs against closed forms, its verdicts."""

import numpy as np
import pytest

from experiments import publish
from experiments.common import table
from experiments.paper import claims, outlook, page, wear
from experiments.paper import statistics as of
from experiments.paper.claims import READINGS, described
from experiments.paper.runs import SIZES, Condition, Reading, drive, solved, table1_law

TIME = np.sort(np.random.default_rng(0).uniform(0, 1, 20_000))
TIME[[0, -1]] = 0.0, 1.0


def test_averages_weigh_samples_by_time():
    assert of.mean(TIME, TIME) == pytest.approx(0.5, rel=1e-12)
    assert of.rms(TIME, 3 * np.sin(2 * np.pi * 5 * TIME)) == pytest.approx(3 / np.sqrt(2), rel=1e-5)
    assert of.spread(TIME, 7 + np.sin(2 * np.pi * 5 * TIME)) == pytest.approx(1 / np.sqrt(2), rel=1e-5)
    assert of.share_above(TIME, TIME - 0.3) == pytest.approx(0.7, abs=1e-4)


def test_spectrum_of_two_sines():
    signal = 2 * np.sin(2 * np.pi * 30 * TIME) + np.cos(2 * np.pi * 120 * TIME)
    frequency, amplitude = of.spectrum(TIME, signal)
    for expected, size in ((30, 2), (120, 1)):
        near = np.abs(frequency - expected) < 5
        assert frequency[near][np.argmax(amplitude[near])] == pytest.approx(expected, abs=0.5)
        assert amplitude[near].max() == pytest.approx(size, rel=1e-2)
    assert of.centre_frequency(TIME, signal) == pytest.approx((4 * 30 + 120) / 5, rel=1e-2)


def test_windows_peaks_and_lags():
    time = np.linspace(0, 1, 1001)
    signal = np.where(time < 0.5, 0.0, np.sin(2 * np.pi * 20 * time))
    assert of.maxima(time, signal, 0.25) == pytest.approx([0, 0, 1, 1], abs=1e-2)
    assert of.ranges(time, signal, 0.25) == pytest.approx([0, 0, 2, 2], abs=1e-2)
    pulse = np.exp(-(((time - 0.4) / 0.05) ** 2))
    later = np.exp(-(((time - 0.43) / 0.05) ** 2))
    assert of.lag(time, later, pulse) == pytest.approx(0.03, abs=1e-3)
    assert of.lag(time, pulse, later) == pytest.approx(-0.03, abs=1e-3)
    assert of.peak_time(time, -later) == pytest.approx(0.43, abs=1e-9)


def test_what_is_in_common_and_what_is_ordered():
    a = np.arange(100.0)
    assert of.in_common(a, a**3) == 1
    assert of.in_common(a, -a) == 0
    assert of.in_common(a, np.where(a < 95, a, -1)) == 0.5
    assert of.rises([1, 2, 3])
    assert not of.rises([1, 3, 2])
    assert not of.rises([1, 1.01, 1.02])
    assert of.falls([3, 2, 1])
    assert not of.falls([1, 1, 0.5])
    assert of.power_of(np.array([1.0, 2.0, 4.0]), np.array([3.0, 3 * 2**0.5, 6.0])) == pytest.approx(0.5)
    assert of.contact_share(np.array([0.0, 0.5]), np.array([0.25, np.nan]), 1.0) == 0.75


def test_readings_are_described_by_what_they_have_in_common():
    plane = {r for r in READINGS if r.world == "plane"}
    assert described(plane, READINGS) == "only for plane"
    assert described({r for r in plane if r.damping == "Table 1"}, READINGS) == "only for plane, Table 1"
    one = Reading("space", "Eq. 7", "diametral")
    assert described(set(READINGS) - {one}, READINGS) == "but for space, Eq. 7, diametral"
    assert described(plane | {one}, READINGS) == "only for plane; Eq. 7, diametral"


def test_table_1_has_the_restitution_that_follows_from_its_numbers():
    assert float(table1_law(1.0).restitution) == pytest.approx(0.41565, abs=1e-5)


def test_velocity_4_in_both_readings():
    assert float(drive("Velocity_4")["drive.joint5.end"][-1]) == 8
    assert float(drive("Velocity_4", "9 s")["drive.joint5.end"][-1]) == 9


@pytest.mark.slow
def test_the_pin_falls_and_swings_as_closed_forms_have_it():
    """It falls with gravity and with the payload's start, whose reaction pushes it the same way; then it swings."""
    start = 6 * np.pi / 2 / 0.5**2 * 0.17662
    for clearance in SIZES:
        m = solved(Reading(), Condition(clearance))
        # The drive's acceleration falls linearly, by a half over a quarter of a second.
        assert m.starts[0] == pytest.approx(np.sqrt(2 * clearance / (9.81 + start)), rel=0.01)
        swing = np.sqrt(9.81 / of.mean(m.time, m.eccentricity)) / (2 * np.pi)
        assert of.centre_frequency(m.time, m.fluctuation) == pytest.approx(swing, rel=0.03)
        assert of.mean(m.time, m.force) == pytest.approx(300 * 9.81, rel=0.1)
        assert m.energy_residual < 1e-8


@pytest.mark.slow
def test_the_quick_page(tmp_path, monkeypatch):
    monkeypatch.setattr(publish, "found", [])
    monkeypatch.setattr(publish, "drawn", [])
    found = page.main(quick=True, out=tmp_path)
    words = {v.claim.key: v.words for v in found.verdicts}
    assert len(words) == len(claims.CLAIMS)
    for key in ("T5b", "T7", "T8", "T9", "T11", "T19"):
        assert words[key] == "holds", key
    assert words["T7c"] == "does not hold"
    assert words["T1"] == "holds only for Table 1"
    for one in found.effects:
        assert one.size > 1.1
    right, wrong = found.compensations
    for one in (right, wrong):
        _, first, _ = one.gone
        assert 0.7 < first[1] < 1
    assert wrong.gone[1][1] < right.gone[1][1]
    (led,) = found.influences
    assert led.error < 1e-4
    assert led.found < led.value
    for path in publish.drawn:
        assert 5_000 < path.stat().st_size < 150_000
    assert "holds only for Table 1" in (tmp_path / "paper_verdicts.md").read_text(encoding="utf-8")
    assert [path.name for path in publish.drawn] == ["paper_6.png", "paper_13.png", "paper_compensation.png"]


@pytest.mark.slow
@pytest.mark.optimised
def test_the_quick_page_of_wear(tmp_path, monkeypatch):
    """Its claims in the literal reading, and that the volume is k times the impulse times the pin's speed."""
    monkeypatch.setattr(publish, "found", [])
    monkeypatch.setattr(publish, "drawn", [])
    found = dict(wear.main(quick=True, out=tmp_path))
    words = {claim.key: wear.verdict(list(own.values())) for claim, own in found.items()}
    assert words == {"T20": "holds", "T20b": "holds", "T20c": "does not hold", "T21": "holds", "T22": "holds"}
    one = wear.first(wear.READINGS[0])
    impulse = float(one.seen.weight @ one.seen.force[:, 0])
    assert float(one.wear.volume) == pytest.approx(6e-14 * impulse * np.pi * 25e-3, rel=0.02)
    for path in publish.drawn:
        assert 5_000 < path.stat().st_size < 150_000
    assert [path.name for path in publish.drawn] == ["paper_14.png", "paper_15.png"]
    assert "**T20c does not hold.**" in "".join(publish.found)
    assert "**does not hold**" in (tmp_path / "paper_wear.md").read_text(encoding="utf-8")


def test_errors_are_averaged_about_each_knot():
    times = np.linspace(0, 1, 501)
    knots = np.linspace(0, 1, 11)
    error = np.stack([np.sin(np.pi * times), times], axis=1)
    found = outlook.averaged(times, error, knots)
    assert found[1:-1, 1] == pytest.approx(knots[1:-1], abs=2e-3)
    assert found[5, 0] == pytest.approx(np.sinc(0.05), abs=1e-3)


def test_a_page_has_its_pictures(tmp_path, monkeypatch):
    """`--out` says where files go; `--save` makes a page of what was found, and keeps the pictures."""
    for name in ("PAGES", "IMAGES"):
        (tmp_path / name).mkdir()
        monkeypatch.setattr(publish, name, tmp_path / name)
    monkeypatch.setattr(publish, "found", [])
    monkeypatch.setattr(publish, "drawn", [])

    def main(quick, out):
        out.mkdir()
        (out / "line.png").write_bytes(b"picture")
        publish.write("Some *words*.")
        publish.picture(out / "line.png", "A line")
        table(("a",), [(1,)], out / "a.md")

    monkeypatch.setattr("sys.argv", ["name", "--save", "--out", str(tmp_path / "there")])
    publish.command(main, "About: `python -m experiments.about`.")
    text = (tmp_path / "PAGES" / "about.md").read_text(encoding="utf-8")
    assert "Some *words*." in text
    assert "![A line](../images/line.png)" in text
    assert "| a |" in text
    assert (tmp_path / "IMAGES" / "line.png").read_bytes() == b"picture"
