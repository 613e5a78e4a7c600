"""Reading of single arguments that every command has."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

# A word that begins as a number does is a value, also where argparse takes it for an option: -3e-2.
NEGATIVE_NUMBER = re.compile(r"-(\d|\.\d|inf|nan)", re.IGNORECASE)


def out_folder(text: str) -> Path:
    """The folder of ``--out``; an empty name would mean the folder that the user is in."""
    if not text.strip():
        raise argparse.ArgumentTypeError("is empty, expected a folder; '.' is the present one")
    return Path(text)
