"""The gallery: `python docs/gallery.py` (`make gallery`) runs every machine of docs/gallery.toml by the command that
its entry shows, draws its picture to docs/images, and writes docs/gallery.md with the numbers of these runs. Names of
examples as arguments run these alone (`front`: the film of the front page).
"""

import re
import sys
import tempfile
import time
import tomllib
from contextlib import chdir
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
import xarray as xr
from PIL import Image, ImageSequence

import clearance_jax as cj

DOCS = Path(__file__).parent
LIST, PAGE, IMAGES = DOCS / "gallery.toml", DOCS / "gallery.md", DOCS / "images"
WIDEST, COLOURS = 760, 48
"""Of a picture [pixels], and its number of colours."""
FILM = 560
"""Of the film [pixels]."""
LARGEST_RESIDUAL = 1e-4
"""A run with a larger energy residual is not shown."""


class Machine(NamedTuple):
    """An entry: the example, what is shown of it, and a sentence with the numbers of its run. Its `joint` may be a gap.

    `since`: what comes before [s] counts neither in the force nor in the error: the fall of pins from the middle of
    their sleeves. `at`: the share of the motion at which the picture is taken.
    """

    example: str
    title: str
    sentence: str
    joint: str
    point: str
    since: float = 0.0
    at: float = 0.5
    options: str = ""

    @property
    def command(self) -> str:
        """The command that runs it, in a folder that has the example."""
        return " ".join(
            filter(None, ["clearance simulate", f"{self.example}.toml", self.options, f"-o {self.example}.nc"])
        ).replace("  ", " ")


MACHINES = tuple(Machine(**one) for one in tomllib.loads(LIST.read_text(encoding="utf-8"))["machine"])


def run(machine: Machine) -> xr.Dataset:
    """The dataset of its command, in the current folder."""
    from typer.testing import CliRunner

    from clearance_jax.cli.main import app

    result = CliRunner().invoke(app, machine.command.split()[1:])
    if result.exit_code:
        raise SystemExit(f"{machine.command}: {result.output}{result.exception!r}")
    return cj.load_dataset(f"{machine.example}.nc")


def shown(value: float, unit: str) -> str:
    """A length [m], a force [N], a torque [N m], an angle [rad] or a frequency [Hz] with three digits, in a unit that
    suits it.
    """
    scales = {"m": ((1e-3, "mm"), (1e-6, "um")), "N": ((1e3, "kN"), (1.0, "N")), "Hz": ((1.0, "Hz"),)}
    scales |= {"N m": ((1e3, "kN m"), (1.0, "N m")), "rad": ((np.pi / 10800, "arcmin"),)}
    scales = scales[unit]
    scale, name = next((one for one in scales if abs(value) >= one[0]), scales[-1])
    return f"{float(f'{value / scale:.3g}'):g} {name}"


def frequency(time: np.ndarray, signal: np.ndarray) -> float:
    """The strongest frequency of a signal [Hz]."""
    share = np.abs(np.fft.rfft((signal - signal.mean()) * np.hanning(signal.size)))
    return float(np.fft.rfftfreq(signal.size, time[1] - time[0])[np.argmax(share[1:]) + 1])


def numbers(machine: Machine, dataset: xr.Dataset) -> dict[str, str]:
    """What its sentence may name."""
    late = dataset["time"].values >= machine.since
    known = cj.parameters(cj.load(cj.examples.path(machine.example)))
    if "gap" in dataset.coords and machine.joint in dataset["gap"].values:
        gap = dataset.sel(gap=machine.joint)
        mine = dataset["gap_episode_gap"].values == list(dataset["gap"].values).index(machine.joint)
        peak = float(dataset["gap_peak_force"].values[mine].max())
        effort = shown(peak, str(gap["gap_effort_unit"].values))
        width = known[f"{machine.joint.removesuffix('_drive')}.backlash"].value
        return {
            "force": effort,
            "touches": str(mine.sum()),
            "clearance": shown(float(width), str(gap["gap_unit"].values)),
        }
    force = dataset["contact_force"].sel(joint=machine.joint).values[late].max()
    index = list(dataset["joint"].values).index(machine.joint)
    found = {"force": shown(float(force), "N"), "touches": str(int((dataset["episode_joint"].values == index).sum()))}
    name = f"{machine.joint}.radial_clearance"
    if name in known:
        found["clearance"] = shown(float(known[name].value), "m")
    if "{frequency}" in machine.sentence:
        speed = dataset["velocity"].sel(point=machine.point, axis="y").values[late]
        found["frequency"] = shown(frequency(dataset["time"].values[late], speed), "Hz")
    return found


def sentence(machine: Machine, dataset: xr.Dataset) -> str:
    """What its run found; with the error of its point, where the dataset has it."""
    said = machine.sentence.format(**numbers(machine, dataset))
    if "position_error" in dataset:
        late = dataset["time"].values >= machine.since
        error = float(dataset["position_error"].sel(point=machine.point).values[late].max())
        ideal = (
            "without play"
            if machine.joint in dataset.coords.get("joint", [])
            else "with rigid drives, without backlash"
        )
        said += f" Its point `{machine.point}` is up to {shown(error, 'm')} from its place on the machine {ideal}."
    return said


def picture(machine: Machine, dataset: xr.Dataset, path: Path) -> None:
    """A frame of its film: the machine, and a joint magnified."""
    film = cj.animate(dataset, machine.joint)
    figure = film.show(int(machine.at * (len(film) - 1)))
    figure.savefig(path, dpi=80)
    image = Image.open(path).convert("RGB")
    image.thumbnail((WIDEST, WIDEST), Image.Resampling.LANCZOS)
    image.quantize(COLOURS).save(path, optimize=True)


def section(machine: Machine, dataset: xr.Dataset, images: Path = IMAGES) -> str:
    """Draw a machine, and give its section of the page."""
    residual = float(dataset.attrs["energy_residual"])
    assert residual < LARGEST_RESIDUAL, f"{machine.example}: energy residual {residual:.1e}"
    picture(machine, dataset, images / f"gallery_{machine.example}.png")
    said = sentence(machine, dataset)
    print(f"{machine.example}: energy residual {residual:.1e}. {said}", flush=True)
    shell = f"clearance examples {machine.example}\n{machine.command}"
    image = f"![{machine.title}](images/gallery_{machine.example}.png)"
    return f"## {machine.title}\n\n{image}\n\n{said}\n\n```shell\n{shell}\n```\n"


def entry(machine: Machine) -> str:
    """Run a machine in an empty folder, and give its section of the page."""
    from clearance_jax.cli.examples import needed

    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        for name, text in needed(cj.examples.path(machine.example)).items():
            Path(name).write_text(text, encoding="utf-8")
        began = time.perf_counter()
        dataset = run(machine)
        print(f"{machine.example}: {time.perf_counter() - began:.1f} s", flush=True)
        return section(machine, dataset)


def write(sections: dict[str, str]) -> None:
    """Write the page, with sections that it has and does not get anew as they are."""
    old = PAGE.read_text(encoding="utf-8") if PAGE.exists() else ""
    for found in re.split(r"^(?=## )", old, flags=re.MULTILINE)[1:]:
        title = found.splitlines()[0].removeprefix("## ")
        sections.setdefault(title, found.rstrip() + "\n")
    ordered = [sections[machine.title] for machine in MACHINES if machine.title in sections]
    PAGE.write_text("\n".join([HEAD, *ordered]), encoding="utf-8")


def front(path: Path = IMAGES / "front.gif") -> None:
    """The film of the front page: a revolution of the slider-crank, small enough to be kept with the source."""
    crank, revolution = cj.examples.slider_crank(), 0.012
    dataset = cj.to_dataset(crank, cj.trace(crank, 2 * revolution, rtol=1e-8, save_at=1001))
    film = cj.animate(dataset, "wrist", span=(revolution, 2 * revolution), slowdown=300.0, fps=7.0)
    with tempfile.TemporaryDirectory() as folder:
        whole = Image.open(film.save(Path(folder) / "whole.gif"))
        frames = []
        for image in ImageSequence.Iterator(whole):
            small = image.convert("RGB")
            small.thumbnail((FILM, FILM), Image.Resampling.LANCZOS)
            frames.append(small.quantize(32, dither=Image.Dither.NONE))
        frames[0].save(path, save_all=True, append_images=frames[1:], duration=143, loop=0, optimize=True)


HEAD = """# Gallery: machines with play

Each machine is an [example](scenes.md) of the package. A picture is one instant of the motion: the machine, and beside
it the pin in its sleeve, with the play magnified, or below it the place in the gap of a drive. The commands below a
picture repeat the run, and `clearance animate NAME.nc -o NAME.gif` makes a film of it. The fall of pins from the middle
of their sleeves is left out of the numbers, where a machine does not start settled.

*This page is written by `make gallery`, with the numbers of its runs.*
"""


def main(wanted: list[str]) -> None:
    """Run all machines, or those that are named, and write the page."""
    cj.configure(cache=True)
    with mpl.rc_context({"font.size": 9}):
        for machine in MACHINES:
            if not wanted or machine.example in wanted:
                write({machine.title: entry(machine)})
        if not wanted or "front" in wanted:
            front()


if __name__ == "__main__":
    main(sys.argv[1:])
