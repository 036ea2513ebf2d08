"""The description on a package index: README.md without its links and pictures inside the repository."""

import re
from pathlib import Path

from hatchling.metadata.plugin.interface import MetadataHookInterface

INSIDE = r"\((?!https?:)[^)]*\)"


def self_contained(text: str) -> str:
    """The text without pictures (and the line below one), and without links, that lead into the repository."""
    text = re.sub(rf"!\[[^\]]*\]{INSIDE}\n(?:\*.*\*\n)?", "", text)
    return re.sub(rf"\[([^\]]+)\]{INSIDE}", r"\1", text)


class CustomMetadataHook(MetadataHookInterface):
    """Hatchling asks it for the field `readme`."""

    def update(self, metadata: dict) -> None:
        """Set the field."""
        text = Path(self.root, "README.md").read_text(encoding="utf-8")
        metadata["readme"] = {"content-type": "text/markdown", "text": self_contained(text)}
