"""A report on one small device, for the tests of what it says and of how it looks."""

import re
import shutil
from dataclasses import dataclass
from pathlib import Path

from femnl.core import resources
from femnl.report import Device, Drive, Published, write_report
from femnl.report.benchmarks import NAME as BENCHMARKS
from femnl.report.blind import NAME as BLIND
from femnl.report.published import SQUARE

HOSTILE = "<script>window.hacked = 1</script>"
GEOMETRY = f"""
name = "square-100um"
source = "made up {HOSTILE}"
assumed = ["film.poisson"]
[outline]
kind = "square"
side = "100 um"
[film]
thickness = "200 nm"
young = "250 GPa"
poisson = 0.23
density = "3100 kg/m^3"
stress = "1 GPa"
[readout]
gap = "3226.25 nm"
"""
CASES = {
    "holds": "Case(claim='Two and two is four {hostile}', source='counting fingers', "
    "references=(Reference('sum', "
    "4.0, relative=1e-9),), "
    "compute=lambda: [(4.0, 1e-12)])",
    "differs": "Case(claim='Two and two is five', source='a novel', "
    "references=(Reference('sum', "
    "5.0, 'm', absolute=0.1),), "
    "compute=lambda: [4.0])",
    "corrects": "Case(claim='π is no 3', source='Archimedes of Syracuse', why='it was rounded "
    "too far', "
    "references=(Reference('π', 3.14159265, absolute=1e-6, printed=3.0),), compute=lambda: "
    "[3.14159265358979])",
    "breaks": "Case(claim='Nothing is divided by zero', source='counting fingers', "
    "references=(Reference('q', "
    "1.0, relative=1e-3),), "
    "compute=lambda: [1 / 0])",
}
PUBLISHED = Published(
    source="made up",
    frequency={"(1,1)": 4.0e6},
    ratio={"(2,2)": 2.0},
    ratio_kind="measured",
    ideal=SQUARE.ideal,
    alpha={"(1,1)": 4e10},
    drives=(Drive("red", 632.8e-9, 4.0),),
    highest=21,
)


@dataclass(frozen=True)
class Written:
    """A report, the geometry that it is about, and what it said while it was made."""

    path: Path
    geometry: Path
    steps: list[str]

    @property
    def text(self) -> str:
        """The page without its pictures and scripts."""
        page = re.sub(r'src="data:[^"]*"', 'src=""', self.path.read_text(encoding="utf-8"))
        return re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)


def make_report(folder: Path) -> Written:
    """Write a report on one small device and four cases.

    One case differs and one breaks; the shipped study and benchmarks are in it.
    """
    geometry = folder / "square-100um.toml"
    geometry.write_text(GEOMETRY, encoding="utf-8")
    cases = folder / "cases"
    cases.mkdir()
    for name, case in CASES.items():
        source = (
            "from femnl.validation import Case, Reference\nCASE = "
            f"{case.replace('{hostile}', HOSTILE)}\n"
        )
        (cases / f"{name}.py").write_text(source, encoding="utf-8")
    for name in (BLIND, BENCHMARKS):
        shutil.copy(resources.cases() / name, cases)
    steps: list[str] = []
    device = Device("Square & small", (str(geometry),), PUBLISHED)
    path = write_report(folder / "out", steps.append, cache=False, devices=[device], cases=cases)
    return Written(path, geometry, steps)
