"""Where the files of the checkout lie that tests read."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SCENES = ROOT / "experiments" / "scenes"
REFERENCE = ROOT / "experiments" / "reference" / "data"
