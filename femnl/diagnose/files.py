"""A diagnosis as the object of `diagnosis.json`, and on disk."""

import json
from pathlib import Path
from typing import Any

from femnl.core.diagnosis import Diagnosis, NoiseTold
from femnl.core.errors import ParameterError
from femnl.io.results.atomic import write_whole

VERSION = "1.1"


def record(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return a diagnosis as the object of `diagnosis.json`."""
    return {
        "femnl_diagnosis": VERSION,
        "file": diagnosis.file,
        "sha256": diagnosis.sha256,
        "verdict": diagnosis.verdict,
        "causes": list(diagnosis.causes),
        "probability": diagnosis.probability,
        "parameters": {
            owner: {name: {"value": p.value, "sd": p.sd, "unit": p.unit} for name, p in own.items()}
            for owner, own in diagnosis.parameters.items()
        },
        "alternatives": [
            {"causes": list(a.causes), "probability": a.probability} for a in diagnosis.alternatives
        ],
        "misfit": {"p_value": diagnosis.p_value, "where": diagnosis.where},
        "before": vars(diagnosis.before),
        "after": vars(diagnosis.after),
        "gain": diagnosis.gain,
        "measure_next": diagnosis.measure_next,
        "shares": {
            told.cause: {"share": told.share, "sd": told.sd, "alone": told.alone}
            for told in diagnosis.shares
        },
        "remainder": None if diagnosis.remainder is None else vars(diagnosis.remainder),
        "excluded": [vars(datum) for datum in diagnosis.excluded],
        "noise": _noise_record(diagnosis.noise),
    }


def _noise_record(told: tuple[NoiseTold, ...]) -> dict[str, Any]:
    """Return stated and found noise; of several measurements those of each by its name too."""
    rows = [
        {"stated": n.stated, "found": n.found, "correlation_length": n.correlation_length}
        for n in told
    ]
    if len(told) < 2:
        return rows[0] if rows else {}
    return rows[0] | {"measurements": dict(zip((n.measurement for n in told), rows, strict=True))}


def write(diagnosis: Diagnosis, folder: str | Path) -> None:
    """Write `diagnosis.json` into a folder, which is made where it is missing."""
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ParameterError(
            f"{folder}: no folder can be made there ({error.strerror}); choose another with --out"
        ) from error
    text = json.dumps(record(diagnosis), ensure_ascii=False, indent=1)

    def save(file: Path) -> None:
        file.write_text(text, encoding="utf-8")

    write_whole(folder / "diagnosis.json", save)
