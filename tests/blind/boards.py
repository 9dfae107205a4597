"""One scoreboard of several studies: `python -m tests.blind.boards OUT NAME=FOLDER …`."""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

VERSION = "1.1"


def main(words: Sequence[str] | None = None) -> None:
    """Replace the named studies of a scoreboard by those in folders; others stay as they are.

    words: of the command line.
    """
    parser = argparse.ArgumentParser(description="keep scoreboards of studies in one file")
    parser.add_argument("out", type=Path)
    parser.add_argument("studies", nargs="+", help="NAME=FOLDER, where FOLDER/scoreboard.json is")
    given = parser.parse_args(words)
    boards = {"femnl_blind": VERSION}
    if given.out.is_file():
        boards = json.loads(given.out.read_text("utf-8"))
        if boards.get("femnl_blind") != VERSION:
            # Its studies have another form, and would stand beside the new ones
            parser.error(f"{given.out}: is not of version {VERSION}; remove it")
    for study in given.studies:
        name, folder = study.split("=", 1)
        boards[name] = json.loads((Path(folder) / "scoreboard.json").read_text("utf-8"))
    given.out.write_text(json.dumps(boards, indent=1, ensure_ascii=False), "utf-8")


if __name__ == "__main__":
    main()
