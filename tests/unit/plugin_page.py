"""The files of docs/howto/plugins.md, which is the package that tests of plug-ins install."""

import re
from pathlib import Path

from femnl import effects
from femnl.effects import library
from femnl.io import labfiles

PAGE = (Path(__file__).parents[2] / "docs" / "howto" / "plugins.md").read_text(encoding="utf-8")
FILES = dict(re.findall(r"^```\w+\n# file: (\S+)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL))
EFFECT = FILES["our_effects/softening.py"]
CAUSE = "drive_softening"


def forget() -> None:
    """Let plug-ins be looked for anew."""
    for found in (effects._defined, library, labfiles.formats):
        found.cache_clear()
