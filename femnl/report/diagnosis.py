"""One page for one diagnosis: verdict, what deviates, what was tried, how to reproduce it."""

import base64
import io
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from matplotlib.figure import Figure

import femnl
from femnl.storage import write_whole
from femnl.types.diagnosis import Diagnosis

NAME = "report.html"


def write_diagnosis(diagnosis: Diagnosis, folder: Path) -> Path:
    """Write `report.html`, a page that needs no other file, into a folder that exists. Returns: its path."""
    loader = FileSystemLoader(Path(__file__).parent)
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    page = environment.get_template("diagnosis.html.j2").render(
        d=diagnosis,
        version=femnl.__version__,
        p_value=f"{diagnosis.p_value:.2g}",
        before=f"{diagnosis.before.heldout_chi2_reduced:.4g}",
        after=f"{diagnosis.after.heldout_chi2_reduced:.4g}",
        gain=f"{diagnosis.gain:.4g}",
        picture=_picture(diagnosis),
        parameters=[
            [owner, p.name, f"{p.value:.8g}", f"{p.sd:.2g}", p.unit] for owner, own in diagnosis.parameters.items() for p in own.values()
        ],
        trials=[
            [" + ".join(t.causes) or "base model", f"{t.chi2:.6g}", f"{t.log_evidence:+.4g}", f"{t.p_value:.2g}", "; ".join(t.against)]
            for t in sorted(diagnosis.trials, key=lambda trial: -trial.log_evidence)
        ],
    )
    path = folder / NAME
    write_whole(path, lambda file: _save(file, page))
    return path


def _save(file: Path, page: str) -> None:
    file.write_text(page, encoding="utf-8")


def _picture(diagnosis: Diagnosis) -> str:
    """Both sets of residuals on one scale, as a data URI."""
    figure = Figure(figsize=(9, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    pairs = ((left, diagnosis.residuals[0], "base model"), (right, diagnosis.residuals[1], " + ".join(diagnosis.causes) or "base model"))
    for axes, residuals, title in pairs:
        axes.axhspan(-2, 2, color="0.9")
        axes.plot(residuals, ".", markersize=6 if len(residuals) < 200 else 1.5, color="C0", rasterized=True)
        axes.set_title(title)
        axes.set_xlabel("datum")
    left.set_yscale("symlog", linthresh=3)
    left.set_ylabel("residual (σ)")
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=130)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()
