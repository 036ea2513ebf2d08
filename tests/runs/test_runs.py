"""What every run on disk holds to, whichever it is: a sweep's store, a life's journal, a search's record.

It goes on after a kill to the same bytes; another question is refused in words; what is damaged is said and computed
again; what the disk refuses is one sentence.
"""

import multiprocessing
import os
import re
import signal
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
import running
from places import refused
from running import RUNS, allow, no_longer_than, somebody

from clearance_jax.errors import ClearanceError
from clearance_jax.runs.journal import BEGIN, Journal, RunWarning, line_of

IDENTITY = sys.modules["clearance_jax.runs.identity"]
EACH = pytest.mark.parametrize("name", RUNS)


@pytest.fixture(autouse=True)
def work(monkeypatch):
    """What grows by how many lanes, cycles or designs are computed."""
    return running.install(monkeypatch.setattr)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Of each run its answer and its journal's bytes, with nobody in its way."""
    folder = tmp_path_factory.mktemp("whole")
    with pytest.MonkeyPatch.context() as patch:
        running.install(patch.setattr)
        answers = {name: run.ask(folder / name) for name, run in RUNS.items()}
    return {name: (answers[name], RUNS[name].journal(folder / name).read_bytes()) for name in RUNS}


def same(found, expected):
    assert found.keys() == expected.keys()
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values)


def stopped(name, path, count):
    """A run that is stopped once so many steps are done."""
    steps = []

    def stop(done):
        steps.append(done)
        if len(steps) == count:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        RUNS[name].ask(path, stop)


@pytest.mark.slow
@EACH
def test_goes_on_to_the_same_bytes(name, tmp_path, whole, work):
    """Stopped again and again; what was done is not done again, and a run that is done does nothing."""
    answer, journal = whole[name]
    path, run = tmp_path / "run", RUNS[name]
    for count in (3, 2, 4):
        before = run.kept(path) if path.exists() else 0
        stopped(name, path, count)
        assert run.kept(path) > before
    same(run.ask(path), answer)
    assert run.journal(path).read_bytes() == journal
    done = sum(work)
    same(run.ask(path), answer)
    assert sum(work) == done
    assert run.journal(path).read_bytes() == journal


@EACH
def test_growing_computes_only_what_is_new(name, tmp_path, work):
    """A sweep grows by longer axes, lives by more values, a search by more designs."""
    path, run = tmp_path / "run", RUNS[name]
    run.ask(path, **run.small)
    done = sum(work)
    grown = run.ask(path, **run.grown)
    assert sum(work) - done == run.more
    assert [one.name for one in tmp_path.iterdir()] == ["run"]
    same(grown, run.ask(tmp_path / "new", **run.grown))


@EACH
def test_another_question_is_refused_in_words(name, tmp_path, monkeypatch):
    """A number, an option, a law or metric, a function of the user's, the library's source; nothing is written."""
    path, run = tmp_path / "run", RUNS[name]
    stopped(name, path, 3)
    before = run.journal(path).read_bytes()
    for changes, words in run.changes.values():
        with pytest.raises(
            ClearanceError, match=f"`{path}` belongs to another question: .*{words}.*Choose another path"
        ):
            run.ask(path, **changes)
    digest = IDENTITY.source_digest()
    with monkeypatch.context() as patch:
        patch.setattr(IDENTITY, "source_digest", lambda: "another")
        said = f"`{path}` was begun by another version of the library: .* is another here and {digest} there"
        with pytest.raises(ClearanceError, match=said):
            run.ask(path)
    assert run.journal(path).read_bytes() == before


@EACH
def test_a_torn_end_is_as_if_it_had_never_been(name, tmp_path, whole):
    """Of a record, and of the question itself."""
    answer, journal = whole[name]
    path, run = tmp_path / "run", RUNS[name]
    run.ask(path)
    lines = journal.splitlines(keepends=True)
    for torn in (lines[-1][:-1], lines[-1][:40], lines[-1][:5]):
        run.journal(path).write_bytes(b"".join(lines[:-1]) + torn)
        same(run.ask(path), answer)
        assert run.journal(path).read_bytes() == journal
    if name != "sweep":  # whose store is there with its question, or not at all
        for torn in (b"", lines[0][:50], lines[0][:5]):
            path.write_bytes(torn)
            same(run.ask(path), answer)
            assert path.read_bytes() == journal


@EACH
def test_what_is_damaged_is_said_and_computed_again(name, tmp_path, whole):
    """Of records that follow from each other with those behind it; of others nothing else, and it stays."""
    answer, journal = whole[name]
    path, run = tmp_path / "run", RUNS[name]
    run.ask(path)
    lines = journal.splitlines(keepends=True)
    at = re.search(rb"[1-8]", lines[4][60:])  # another number, and still JSON
    assert at is not None
    bad = lines[4][: 60 + at.start()] + b"9" + lines[4][60 + at.end() :]
    run.journal(path).write_bytes(b"".join([*lines[:4], bad, *lines[5:]]))
    said = "line 5 is damaged; it and what follows are" if name == "life" else "1 line is damaged; what it held is"
    with pytest.warns(RunWarning, match=f"`{run.journal(path)}`: {said} computed again"):
        same(run.ask(path), answer)
    found = run.journal(path).read_bytes()
    assert found == (journal if name == "life" else b"".join([*lines[:4], bad, *lines[5:], lines[4]]))


@EACH
def test_a_question_that_is_damaged(name, tmp_path, whole):
    """Where records follow from each other nothing is left. Else the fingerprint tells, and it is written anew."""
    answer, journal = whole[name]
    path, run = tmp_path / "run", RUNS[name]
    run.ask(path)
    lines = journal.splitlines(keepends=True)
    damaged = lines[0][:40] + b"?" + lines[0][41:]
    if name == "life":
        for left in (damaged, damaged + b"".join(lines[1:]), b"".join(lines[1:])):
            path.write_bytes(left)
            with refused(path, None):
                run.ask(path)
            assert path.read_bytes() == left
        return
    run.journal(path).write_bytes(damaged + b"a letter\n" + b"".join(lines[1:]))
    with pytest.warns(RunWarning, match="2 lines are damaged; what they held is computed again"):
        same(run.ask(path), answer)
    assert Journal(run.journal(path)).question is not None
    changes, words = run.changes["a number"]
    with pytest.raises(ClearanceError, match=words):
        run.ask(path, **changes)
    run.journal(path).write_bytes(b"".join(lines[1:]))
    with refused(path, "question"):
        run.ask(path, **changes)


# What other files begin with, and journals of earlier forms.
OTHERS = (
    b"a letter",
    b"a letter\n",
    b'{"a": 1}\n',
    b"5\n",
    b"[1]\n",
    b"\0",
    BEGIN + b'00000000","a":1}\n',
    line_of({"question": {"t1": 1.0}, "begin": [0.0]}),
    line_of({"names": ["a"], "problem": {"t1": 1.0}}),
    line_of({"event": "question", "fingerprint": "0", "chunk": [8]}),
)


@EACH
def test_what_is_no_journal_is_left_as_it_is(name, tmp_path):
    path, run = tmp_path / "run", RUNS[name]
    stopped(name, path, 2)
    for other in OTHERS:
        run.journal(path).write_bytes(other)
        with pytest.raises(ClearanceError, match=r"no journal of a run, one of an earlier form|its own words are lost"):
            run.ask(path)
        assert run.journal(path).read_bytes() == other


@EACH
def test_a_file_that_cannot_be_read(name, tmp_path, monkeypatch):
    path, run = tmp_path / "run", RUNS[name]
    stopped(name, path, 2)
    read = Path.read_bytes

    def refused(file):
        if file == run.journal(path):
            raise PermissionError(13, "Permission denied")
        return read(file)

    monkeypatch.setattr(Path, "read_bytes", refused)
    with pytest.raises(ClearanceError, match=r"Cannot open .*Permission denied. Choose another path"):
        run.ask(path)


@pytest.mark.parametrize("name", ["life", "search"])
def test_a_path_that_is_none(name, tmp_path):
    for wrong in (tmp_path, tmp_path / "none" / "run"):
        with pytest.raises(
            ClearanceError, match=r"Cannot (open|write) .*(Is a directory|No such file).*Choose another path"
        ):
            RUNS[name].ask(wrong)


# Disks ---------------------------------------------------------------------------------------------------------------


@EACH
def test_a_full_disk(name, tmp_path, whole, monkeypatch):
    answer, journal = whole[name]
    path, run = tmp_path / "run", RUNS[name]
    stopped(name, path, 6)
    before = run.journal(path).read_bytes()
    with no_longer_than(len(before) + 40), pytest.raises(ClearanceError) as refused:
        run.ask(path)
    assert re.search(r"Cannot write .*(File too large|No space left).*make room, and go on", str(refused.value))
    assert run.journal(path).read_bytes() == before
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(
        ClearanceError, match=r"Cannot write .*No space left on device\. What was .*make room, and go on"
    ):
        run.ask(path)
    monkeypatch.undo()
    running.install(monkeypatch.setattr)
    assert run.journal(path).read_bytes() == before
    same(run.ask(path), answer)
    assert run.journal(path).read_bytes() == journal


def full(_):
    raise OSError(28, "No space left on device")


@EACH
def test_where_nothing_can_be_written(name, whole):
    answer, journal = whole[name]
    run = RUNS[name]
    with tempfile.TemporaryDirectory() as folder:  # not below a folder that is one user's
        path = Path(folder) / "run"
        stopped(name, path, 3)
        allow(Path(folder), writable=False)
        with somebody():
            for place in (path, Path(folder) / "other"):
                with pytest.raises(ClearanceError, match=r"Cannot (open|write) .*Permission denied\. (Choose|What)"):
                    run.ask(place)
        allow(Path(folder), writable=True)
        same(run.ask(path), answer)
        assert run.journal(path).read_bytes() == journal


# Kills ---------------------------------------------------------------------------------------------------------------


@EACH
def test_killed_at_random_moments(name, tmp_path, whole, work):
    """Nothing that was said to be done is lost, nothing is there twice, and the answer is that of a run which nobody
    killed. While it lives nobody else writes; to the record of a search several may.
    """
    answer, journal = whole[name]
    path, run, random = tmp_path / "run", RUNS[name], np.random.default_rng(1)
    processes = multiprocessing.get_context("forkserver")
    processes.set_forkserver_preload(running.IMPORTED)
    done = 0
    for count in (2, 3):
        ours, theirs = processes.Pipe()
        plain = os.environ["JAX_DISABLE_MOST_OPTIMIZATIONS"] == "1"
        process = processes.Process(target=running.victim, args=(name, path, plain, theirs))
        process.start()
        theirs.close()
        for _ in range(count):
            done = ours.recv()
            ours.send(True)
        process.join(random.uniform(0.0, 0.02))
        assert process.pid is not None
        os.kill(process.pid, signal.SIGSTOP)
        try:
            if run.writer:
                said = f"is being written by (process {process.pid} on|another process)"
                with pytest.raises(ClearanceError, match=said):
                    run.ask(path)
        finally:  # one that is stopped would be waited for without end
            process.kill()
            process.join()
        assert run.kept(path) >= done
    kept = run.kept(path)
    same(run.ask(path), answer)
    assert sum(work) == run.every - kept
    assert run.journal(path).read_bytes() == journal


def test_two_searches_lose_nothing_of_each_other(tmp_path):
    """One of them dies while it writes."""
    path = tmp_path / "record"
    first, second = (Journal(path) for _ in range(2))
    first.ask({"mass": 1.0})
    second = Journal(path)
    second.ask({"mass": 1.0})
    first.add(x=1)
    second.add(x=2)
    with path.open("ab") as file:
        file.write(line_of({"of": "0", "x": 9})[:-5])
    first.add(x=3)
    second.add(x=4)
    assert Journal(path).records == [{"x": 1}, {"x": 2}, {"x": 3}, {"x": 4}]
