"""A seeded fuzzer of scenes, studies, trajectories and command lines: `python -m tests.fuzz --count 10000 --solve 200`.

Every case is a shipped scene or study, or a command line on one, with a few things changed that people or machines get
wrong. It must load (and is laid out, and by some solved), or be refused by one sentence: no traceback, no hang, nothing
executed, nothing written but what was asked for.
"""

import argparse
import collections
import contextlib
import faulthandler
import functools
import io
import os
import platform
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax

from tests.fuzz_cases import CANARY, SCENES, Case, cases

# The setting of JAX that says where it keeps programs.
CACHE = "jax_compilation_cache_dir"
# What no case may take longer than [s].
LONGEST_CASE = 20
# What Python tells of that nobody who reads a file has to do.
FORBIDDEN = {"os.system", "subprocess.Popen", "os.exec", "os.posix_spawn", "os.spawn", "os.fork", "socket.connect"}


class Hang(BaseException):
    """A case takes too long."""


class Violation(Exception):
    """What no input may bring about."""


class Watch:
    """What is executed, and written outside a folder and those that programs keep for themselves, while it is on."""

    def __init__(self, folder: Path):
        kept = (getattr(jax.config, CACHE), "/dev/null", str(folder))
        self.kept = tuple(os.path.realpath(path) for path in kept if path)
        self.on, self.seen = False, []
        self.asked: tuple[str, ...] = ()
        sys.addaudithook(self._hear)

    def _hear(self, event: str, given: tuple) -> None:
        if not self.on:
            return
        if event in FORBIDDEN:
            self.seen.append(f"{event}{given!r:.200}")
        elif event == "open" and isinstance(given[0], str | bytes):
            path, mode, flags = os.fsdecode(given[0]), given[1] or "", given[2] or 0
            writes = set(mode) & set("wax+") or flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
            if writes and not os.path.realpath(path).startswith(self.kept) and not self._is_asked(path):
                self.seen.append(f"{event} {path!r:.200}")

    def _is_asked(self, path: str) -> bool:
        """Whether it is a file that the command line names, the one beside it that becomes it, or their folder."""
        folder, name = os.path.split(path)
        asked = [os.path.split(argument) for argument in self.asked if os.path.isabs(argument)]
        return any(path == place or (folder == place and own in name) for place, own in asked)


@contextlib.contextmanager
def no_longer_than(seconds: float) -> Iterator[None]:
    """Interrupt what takes longer; end the process, with a traceback, where even that is not possible."""

    def ring(*_):
        raise Hang

    signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    faulthandler.dump_traceback_later(10 * seconds, exit=True)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        faulthandler.cancel_dump_traceback_later()


def tried(case: Case, folder: Path) -> tuple[str, Any]:
    """How a case ended ("loaded", "refused"), and what it loaded. **Raises** whatever it must not."""
    from clearance_jax.errors import LONGEST, ClearanceError

    path = folder / _file_name(case)
    path.write_bytes(case.text)
    if case.kind == "command":
        return commanded(case), None
    try:
        return "loaded", laid_out(case.kind, path)
    except ClearanceError as error:
        if not 0 < len(str(error)) <= LONGEST:
            raise Violation(f"a message of {len(str(error))} characters") from error
        return "refused", None


def _file_name(case: Case) -> str:
    if case.kind in ("urdf", "trajectory"):
        return {"urdf": "robot.urdf", "trajectory": "trajectory.csv"}[case.kind]
    return "study.toml" if case.kind == "study" or "run" in case.arguments else "scene.toml"


def laid_out(kind: str, path: Path) -> Any:
    """What a file describes, with what is made of it before a solve."""
    from clearance_jax.dynamics.quantities import labels
    from clearance_jax.io.scene.scene import load_scene
    from clearance_jax.io.study.study import load_study
    from clearance_jax.mechanism.state import layout
    from clearance_jax.parameters import check_values

    if kind == "trajectory":
        return driven(path)
    if kind == "study":
        study = load_study(path)
        if study.design is not None:
            specification = study.design.problem.specification
            assert len(specification.bounds[0]) == len(specification.names)
        return study
    if kind == "urdf":
        return _robot(path)
    scene = load_scene(path)
    check_values(scene.mechanism)
    plan = layout(scene.mechanism)
    assert plan.size >= 2 * plan.free
    assert labels(scene.mechanism)
    return scene


def driven(path: Path) -> Any:
    """A mechanism that a trajectory drives, whose splines are finite inside and at both ends."""
    import numpy as np

    from clearance_jax.io.trajectory import read_trajectory

    drives = read_trajectory(path, moved())
    assert drives
    for drive in drives.values():
        assert np.all(np.isfinite(drive.prepare().curvature))
        assert np.all(np.diff(drive.times) > 0)
    return moved().with_drives(drives)


@functools.cache
def moved() -> Any:
    """What the trajectories are of: a pendulum on a carriage."""
    import clearance_jax as cj

    joints = (cj.Prismatic("slide", "ground", "carriage"), cj.Revolute("hinge", "carriage", "bob"))
    return cj.Mechanism((cj.Body("carriage", 1.0), cj.Body("bob", 1.0, 1.0)), joints)


def _robot(path: Path) -> Any:
    """The robot of a file on its base, and where it can be moved by itself, off it."""
    from clearance_jax.dynamics.quantities import labels
    from clearance_jax.errors import ClearanceError
    from clearance_jax.io.urdf.mechanism import load_urdf
    from clearance_jax.mechanism.state import layout
    from clearance_jax.parameters import check_values

    with contextlib.suppress(ClearanceError):  # not every root can fly
        load_urdf(path, mimic="independent", base="free", gravity=(0, 0, 0))
    robot = load_urdf(path, mimic="independent")
    check_values(robot)
    assert layout(robot).free >= len(robot.bodies)
    assert labels(robot)
    return robot


class Reached(Exception):
    """A command has come as far as its solve."""


def commanded(case: Case) -> str:
    """How a command ended; up to its solve, which is not begun."""
    from clearance_jax.cli import main
    from clearance_jax.errors import LONGEST

    out, err = io.StringIO(), io.StringIO()
    sys.argv = ["clearance", *case.arguments]
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), unsolved():
            main()
    except Reached:
        return "loaded"
    except SystemExit as ended:
        said = err.getvalue()
        if ended.code in (None, 0, 1):
            return "loaded"
        message = said.split("error: ", 1)[-1].strip()
        if ended.code != 2 or "Traceback" in said or not 0 < len(message) <= LONGEST:
            raise Violation(f"exit code {ended.code}, {len(message)} characters: {said[:2000]}") from None
        return "refused"
    raise Violation("the command did not end")


@contextlib.contextmanager
def unsolved() -> Iterator[None]:
    """Commands end where they would begin to solve, or to compile."""
    from clearance_jax.cli import info
    from clearance_jax.design.asked import problem
    from clearance_jax.solve.drivers import trace

    def reached(*_, **__):
        raise Reached

    kept = trace._begin, problem.search, info._operations
    trace._begin, problem.search, info._operations = reached, reached, reached
    try:
        yield
    finally:
        trace._begin, problem.search, info._operations = kept


def solved(scene: Any) -> str:
    """How a short solve of a loaded scene ends."""
    from clearance_jax.errors import ClearanceError
    from clearance_jax.solve.drivers.trace import trace

    t0 = scene.solve.get("t0", 0.0)
    try:
        result = trace(scene.mechanism, t0 + 1e-5 * max(1.0, abs(t0)), t0=t0, rtol=1e-4, save_at=3, max_steps=200)
    except ClearanceError:
        return "solve refused"
    return f"solve: {result.message or 'successful'}"


class Findings(NamedTuple):
    """Of a run: how cases ended, how long the longest took [s], compiled, and what must not happen (case, report)."""

    ends: collections.Counter
    longest: float
    wrong: list[tuple[str, str]]


def fuzz(count: int, seed: int = 0, solves: int = 0, say: Callable[[str], None] = lambda text: None) -> Findings:
    """Try so many cases, and solve so many of the scenes among them that load."""
    ends, longest, wrong = collections.Counter(), 0.0, []
    home, argv = Path.cwd(), sys.argv
    outside = Path(tempfile.mkdtemp(prefix="fuzz-"))
    watch = Watch(outside)
    # What is made once for all: programs, and compiled files of modules that are imported for the first time.
    laid_out("scene", SCENES[0])
    tried(Case("urdf", b"<robot/>"), outside)
    platform.processor()  # asks a program, once
    try:
        for i, case in enumerate(cases(count, seed)):
            folder = outside / "inside"
            folder.mkdir()
            os.chdir(folder)
            begin, report = time.monotonic(), ""
            try:
                with no_longer_than(LONGEST_CASE), warnings.catch_warnings():
                    warnings.simplefilter("error")
                    for said in _said():
                        warnings.simplefilter("ignore", said)
                    watch.on, watch.asked = True, case.arguments
                    end, loaded = tried(case, folder)
                taken = time.monotonic() - begin
                ends[f"{case.kind} {end}"] += 1
                if end == "loaded" and case.kind == "scene" and solves > 0:
                    solves -= 1
                    end, longer = _solved_in_time(loaded)
                    ends[end] += 1
                    taken = max(taken, longer)
                longest = max(longest, taken)
            except (Exception, Hang):
                report = traceback.format_exc(limit=-6)
            finally:
                watch.on = False
            report += "".join(f"did what it must not: {event}\n" for event in watch.seen)
            report += "".join(f"wrote {path}\n" for path in outside.rglob(f"*{CANARY}*"))
            watch.seen.clear()
            if report:
                wrong.append((f"case {i} of seed {seed}: {case.kind} {case.arguments!r:.200}", report))
                say(f"{wrong[-1][0]}\n{report}")
            os.chdir(home)
            shutil.rmtree(folder)
            if i % 1000 == 999:
                say(f"{i + 1} cases, {dict(ends)}, {len(wrong)} wrong")
    finally:
        sys.argv = argv
        os.chdir(home)
        shutil.rmtree(outside, ignore_errors=True)
    return Findings(ends, longest, wrong)


def _said() -> tuple[type[Warning], ...]:
    """What a reader says of a file that it loads."""
    from clearance_jax.io.urdf.mechanism import NotReadWarning
    from clearance_jax.joints.checks import ImplausibleWarning

    return ImplausibleWarning, NotReadWarning


def _solved_in_time(scene: Any) -> tuple[str, float]:
    """As `solved`, and how long it took [s]; what takes long because it is compiled is timed a second time."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        begin = time.monotonic()
        end = solved(scene)
        if time.monotonic() - begin > LONGEST_CASE:
            begin = time.monotonic()
            with no_longer_than(LONGEST_CASE):
                solved(scene)
    return end, time.monotonic() - begin


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000, help="cases to load and lay out")
    parser.add_argument("--solve", type=int, default=0, help="scenes to solve among those that load")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    import clearance_jax

    clearance_jax.configure(cache=True)
    begin = time.monotonic()
    found = fuzz(given.count, given.seed, given.solve, print)
    print(f"{given.count} cases in {time.monotonic() - begin:.0f} s, the longest {found.longest:.1f} s")
    for end, times in sorted(found.ends.items()):
        print(f"  {end}: {times}")
    print(f"  wrong: {len(found.wrong)}")
    return 1 if found.wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())
