"""The text of a URDF file. What other readers of XML let pass is mended; each mend is a note with its line. Lines stay
as they are in the file.
"""

import codecs
import contextlib
import re
from collections.abc import Iterable

Note = tuple[str, int]
"""What was assumed, in words, and the line of the file."""

# Most kinds in a sentence.
SHOWN = 8
DECLARED = re.compile(rb"""\s*<\?xml\s[^>]*?\bencoding\s*=\s*["']([A-Za-z][\w.-]*)["']""")
# Patterns that need time in proportion to any text: a comment may lack its end, a declaration holds no other tag.
DECLARATION = re.compile(r"<\?xml\s[^<>]*\?>")
COMMENT = r"<!--.*?(?:-->|\Z)"
PREFIXES = re.compile(r"</?([A-Za-z_][\w.-]*):|\s([A-Za-z_][\w.-]*):[\w.-]+\s*=")
# Known prefixes mean what they would if they were declared.
NAMESPACES = {"drake": "http://drake.mit.edu", "xacro": "http://www.ros.org/wiki/xacro"}


def decoded(content: bytes) -> tuple[str, list[Note]]:
    """The text of a file's bytes: in UTF-16 by its mark, else as it declares, else in UTF-8, else in Latin-1."""
    notes, declared = [], DECLARED.match(content)
    names = ["utf-16"] if content[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE) else ["utf-8-sig"]
    for name in [*([declared[1].decode()] if declared else []), *names]:
        with contextlib.suppress(LookupError, UnicodeError):
            text = content.decode(name).removeprefix("\ufeff")
            if text.lstrip().startswith("<"):  # a wrong encoding may give letters too
                break
    else:
        text = content.decode("latin-1")
        notes.append(("a text that is not in UTF-8 is read as Latin-1", 1))
    head, _, tail = text.partition("\0")
    if len(head) < len(text) and not tail.strip("\0 \t\r\n"):
        notes.append(("zero bytes at the end of the file are left out", head.count("\n") + 1))
        text = head
    declaration = DECLARATION.search(text)
    before = text[: declaration.start()] if declaration else ""
    if declaration and before and not re.sub(COMMENT, "", before, flags=re.DOTALL).strip():
        notes.append(("`<?xml ...?>`, which is not at the beginning of the file, is left out", before.count("\n") + 1))
        text = before + "\n" * declaration[0].count("\n") + text[declaration.end() :]
    return text, notes


def with_prefixes(text: str) -> tuple[str, list[Note]]:
    """The text with a declaration of every prefix that has none, in its <robot>."""
    bare = re.sub(COMMENT, lambda match: re.sub(r"[^\n]", " ", match[0]), text, flags=re.DOTALL)
    known = {"xml", "xmlns", *re.findall(r"\bxmlns:([\w.-]+)\s*=", bare)}
    first: dict[str, int] = {}
    for match in PREFIXES.finditer(bare):
        if (prefix := match[1] or match[2]) not in first:
            first[prefix] = bare.count("\n", 0, match.start()) + 1
    unknown = {prefix: line for prefix, line in first.items() if prefix not in known}
    top = re.search(r"<robot(?=[\s>])", bare)
    if top is None or not unknown:
        return text, []
    declared = "".join(f' xmlns:{prefix}="{NAMESPACES.get(prefix, prefix)}"' for prefix in unknown)
    notes = [
        (f"the prefix `{prefix[:60]}`, which is not declared, is taken as declared", n) for prefix, n in unknown.items()
    ]
    return text[: top.end()] + declared + text[top.end() :], notes


def told(what: str, notes: Iterable[Note]) -> tuple[str, ...]:
    """A sentence of at most `SHOWN` kinds of notes, with first line and count; nothing if there are none."""
    lines: dict[str, list[int]] = {}
    for words, line in notes:
        lines.setdefault(words, []).append(line)
    kinds = [f"{words} (line {at[0]}" + (f", {len(at)} times)" if len(at) > 1 else ")") for words, at in lines.items()]
    shown = kinds if len(kinds) <= SHOWN else [*kinds[:SHOWN], f"{len(kinds) - SHOWN} kinds more"]
    return (f"{what}: {', '.join(shown)}",) if shown else ()
