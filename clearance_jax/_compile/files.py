"""Files that are kept between processes: only their owner can write in their folders, and their size is limited.

- Programs as loadable executables, whole or not at all.
- Small answers that take long to ask again, such as those of pint's registry.
"""

import atexit
import contextlib
import json
import os
import stat
from collections.abc import Callable
from hashlib import blake2b
from pathlib import Path
from uuid import uuid4

from clearance_jax._compile.runtime import RUNTIME

# Above this number of bytes (some thousand programs) the least recently used files are removed.
LARGEST = 1 << 30
_MARK = b"clearance_jax program 1\n"
_DIGEST = 32
ENDING = ".program"
# Left by a process that was killed while writing.
_PARTIAL = ".partial"
# Endings of JAX's own cache.
_JAX_ENDINGS = "-cache", "-atime"


def user_cache() -> Path:
    """The user's cache folder."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "clearance_jax"


def jax_folder(cache: Path) -> Path:
    """Where JAX's own cache is, if the library's is in this folder."""
    return Path(os.environ.get("JAX_COMPILATION_CACHE_DIR") or cache)


def programs_in(cache: Path) -> Path:
    """Where programs are kept in a cache folder."""
    return cache / "programs"


def unsafe(folder: Path) -> str:
    """Why files in a folder must not be read, as the end of a sentence; empty if they may be."""
    if not hasattr(os, "getuid"):
        return "this system does not say who can write there"
    try:
        seen = os.lstat(folder)
    except FileNotFoundError:
        return ""
    except OSError as error:
        return f"it cannot be looked at ({error.strerror})"
    if not stat.S_ISDIR(seen.st_mode):
        return "it is no folder"
    if seen.st_uid != os.getuid():
        return "it belongs to another user"
    return "others than its owner can write there" if seen.st_mode & 0o022 else ""


def make_writable(folder: Path) -> bool:
    """Whether files can be kept in a folder, which is made if needed."""
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError:
        return False
    return not unsafe(folder) and os.access(folder, os.W_OK | os.X_OK)


def read(folder: Path, name: str) -> bytes | None:
    """The content under a name; `None` if there is none, or it is damaged, or another user could have written it."""
    path = folder / f"{name}{ENDING}"
    try:
        # Not through a link, and the opened file itself is checked.
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))
        with os.fdopen(handle, "rb") as file:
            seen = os.fstat(handle)
            if not stat.S_ISREG(seen.st_mode) or seen.st_uid != os.getuid() or seen.st_mode & 0o022:
                return None
            content = file.read()
        head = len(_MARK) + _DIGEST
        if content[: len(_MARK)] != _MARK or content[len(_MARK) : head] != _digest(name, content[head:]):
            return None
        with contextlib.suppress(OSError):
            os.utime(path)  # what was used last goes last
        return content[head:]
    except OSError:
        return None


def write(folder: Path, name: str, content: bytes, largest: int = LARGEST) -> bool:
    """Keep a content; returns whether that was possible."""
    try:
        if not make_writable(folder):
            return False
        write_whole(folder / f"{name}{ENDING}", _MARK + _digest(name, content) + content)
        _let_go(folder, largest)
        return True
    except OSError:
        return False


def write_whole(path: Path, content: bytes, mode: int = 0o600) -> None:
    """Write a file that gets its name only when it is complete. **Raises** `OSError` if that is not possible."""
    part = path.with_name(f".{path.name}.{uuid4().hex}{_PARTIAL}")
    try:
        with os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
            file.write(content)
        os.replace(part, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(part)
        raise


def size(folder: Path, endings: tuple[str, ...] = (ENDING,)) -> tuple[int, int]:
    """The number of files with these endings, and their bytes."""
    sizes = [size for _, size, _ in _files(folder, endings)]
    return len(sizes), sum(sizes)


def jax_size(folder: Path) -> tuple[int, int]:
    """The number of programs in JAX's own cache, and the bytes of all its files."""
    return size(folder, _JAX_ENDINGS[:1])[0], size(folder, _JAX_ENDINGS)[1]


def clear(folder: Path, endings: tuple[str, ...] = (ENDING, _PARTIAL)) -> int:
    """Remove every file with these endings and nothing else; returns the number of files that could not be removed."""
    left = 0
    for *_, path in _files(folder, endings):
        try:
            path.unlink(missing_ok=True)
        except OSError:
            left += 1
    return left


def jax_clear(folder: Path) -> int:
    """Remove what JAX's own cache keeps and nothing else; returns the number of files that could not be removed."""
    return clear(folder, (*_JAX_ENDINGS, _PARTIAL))


def _digest(name: str, content: bytes) -> bytes:
    """The digest of content and name, so that a file under another name is not accepted."""
    return blake2b(name.encode() + b"\0" + content, digest_size=_DIGEST).digest()


def _files(folder: Path, endings: tuple[str, ...] = (ENDING,)) -> list[tuple[float, int, Path]]:
    """By file: time of last use, size, path."""
    files = []
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            with contextlib.suppress(OSError):
                seen = path.lstat()
                if path.name.endswith(endings) and stat.S_ISREG(seen.st_mode):
                    files.append((seen.st_mtime, seen.st_size, path))
    return files


def _let_go(folder: Path, largest: int) -> None:
    """Remove the files that were not used for longest, if there is too much."""
    files = _files(folder)
    total = sum(size for _, size, _ in files)
    if total <= largest:
        return
    for _, length, path in sorted(files, key=lambda file: file[0]):
        with contextlib.suppress(OSError):
            path.unlink()
        total -= length
        if total <= 0.9 * largest:
            return


# Answers at most.
_MOST = 20_000
_NAME = "quantities"


def remember_in(folder: Path | None) -> None:
    """Keep programs and answers in this folder from now on; `None`: nowhere."""
    RUNTIME.folder, RUNTIME.new_answers = folder, {}
    RUNTIME.answers = {} if folder is None else _read(folder)


def remember(question: str, ask: Callable[[], float]) -> float:
    """The answer to a question whose text covers everything on which it depends. Errors of `ask` are not kept."""
    if RUNTIME.folder is None:
        return ask()
    if question not in RUNTIME.answers:
        if not RUNTIME.new_answers:
            atexit.register(_write)
        RUNTIME.answers[question] = RUNTIME.new_answers[question] = ask()
    return RUNTIME.answers[question]


def _read(folder: Path) -> dict[str, float]:
    content = None if unsafe(folder) else read(folder, _NAME)
    try:
        return {} if content is None else {key: float.fromhex(value) for key, value in json.loads(content).items()}
    except (ValueError, AttributeError, TypeError):
        return {}


def _write() -> None:
    """Write the new answers; those that other processes have kept meanwhile stay."""
    folder, new = RUNTIME.folder, RUNTIME.new_answers
    if folder is None or not new:
        return
    every = _read(folder) | new
    if len(every) > _MOST:
        every = new
    write(folder, _NAME, json.dumps({key: value.hex() for key, value in every.items()}).encode())
    RUNTIME.new_answers = {}
