"""Mesh devices by this code and by an earlier one, in turn.

Run `python -m benchmarks.meshes [FOLDER [REVISION]]`; it writes meshes.csv. The earlier code is a
revision of the repository, checked out beside this one. Seconds are of a processor, in one process
each; each device is meshed REPEATS times by either code, and the fastest counts.
"""

import csv
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parent.parent
EARLIER = "280d7f5"
"""The last revision before meshes were made faster."""
REPEATS = 2
DEVICES = (
    "hexagon-278um-etched",
    "square-270um-etched",
    "square-270um-perforated",
    "lotus",
    "dandelion",
    "spider-web",
    "soft-clamped-square",
    "trampoline",
)
CORNERS = 140
"""Of a smooth outline that a layout draws as chords."""
FILM = """[film]
thickness = "50 nm"
young = "250 GPa"
poisson = 0.23
density = "3100 kg/m^3"
stress = "1 GPa"
"""


def drawn(path: Path) -> Path:
    """Write a device whose outline, r = 40 + 4 cos 4φ in µm, is a polygon of chords."""
    angle = 2 * np.pi * np.arange(CORNERS) / CORNERS + 0.0071
    radius = 40 + 4 * np.cos(4 * angle)
    corners = zip(radius * np.cos(angle), radius * np.sin(angle), strict=True)
    points = ", ".join(f'["{x:.4f} um", "{y:.4f} um"]' for x, y in corners)
    outline = f'[outline]\nkind = "polygon"\npoints = [{points}]\n'
    path.write_text(f'name = "polygon"\n{outline}{FILM}', encoding="utf-8")
    return path


def meshed(tree: Path, device: str) -> dict[str, float]:
    """Return the seconds and the triangles of a mesh by the code in a folder."""
    command = [sys.executable, str(ROOT / "benchmarks" / "meshes_once.py"), device]
    runs = []
    for _ in range(REPEATS):
        done = subprocess.run(
            command,
            env=os.environ | {"PYTHONPATH": str(tree)},
            check=True,
            capture_output=True,
            text=True,
        )
        runs.append(json.loads(done.stdout))
    return {name: min(run[name] for run in runs) for name in ("seconds", "triangles")}


def main(folder: Path, revision: str = EARLIER) -> None:
    """Mesh every device by either code."""
    rows = []
    with tempfile.TemporaryDirectory() as room:
        earlier = Path(room) / "earlier"
        git = ["git", "-C", str(ROOT), "worktree"]
        subprocess.run([*git, "add", "--detach", str(earlier), revision], check=True)
        try:
            for device in (str(drawn(Path(room) / "polygon.toml")), *DEVICES):
                old = meshed(earlier, device)
                new = meshed(ROOT, device)
                ratio = old["seconds"] / new["seconds"]
                rows.append([Path(device).stem, *old.values(), *new.values(), ratio])
        finally:
            subprocess.run([*git, "remove", "--force", str(earlier)], check=True)
    with (folder / "meshes.csv").open("w", newline="", encoding="utf-8") as file:
        head = [
            "device",
            "before (s)",
            "triangles before",
            "now (s)",
            "triangles now",
            "ratio",
        ]
        csv.writer(file).writerows([head, *rows])


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(), *sys.argv[2:3])
