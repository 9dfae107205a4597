"""A diagnosis as the object of `diagnosis.json`, and on disk."""

import hashlib
import json
from pathlib import Path
from typing import Any

import femnl
from femnl.core.contributions import Account, Contributions, Term
from femnl.core.device import Model
from femnl.core.diagnosis import Covariance, Diagnosis, NoiseTold
from femnl.core.errors import ParameterError
from femnl.core.fit import Parameter
from femnl.core.json_values import json_value
from femnl.io.results.atomic import write_text_whole, write_whole

VERSION = "1.3"
TABLE = "contributions.csv"
DIGITS = "%.12g"
"""Numbers of the table: frequencies are known to 1e-10, and sums shall add up."""


def record(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return a diagnosis as the object of `diagnosis.json`."""
    return {
        "femnl_diagnosis": VERSION,
        "femnl_version": femnl.__version__,
        "file": diagnosis.file,
        "sha256": diagnosis.sha256,
        "geometry": _geometry_record(diagnosis.model),
        "verdict": diagnosis.verdict,
        "causes": list(diagnosis.causes),
        "probability": diagnosis.probability,
        "parameters": {
            owner: {name: _parameter_record(p) for name, p in own.items()}
            for owner, own in diagnosis.parameters.items()
        },
        "covariance": _covariance_record(diagnosis.covariance),
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
        "contributions": _contributions_record(diagnosis.contributions),
    }


def _parameter_record(p: Parameter) -> dict[str, Any]:
    return {"value": p.value, "sd": p.sd, "equation_sd": p.equation_sd, "unit": p.unit}


def _geometry_record(model: Model | None) -> dict[str, str] | None:
    """Return the name and the text of the geometry that was solved, and the digest of the text."""
    if model is None:
        return None
    digest = hashlib.sha256(model.text.encode()).hexdigest()
    return {"name": model.name, "sha256": digest, "text": model.text}


def _covariance_record(found: Covariance | None) -> dict[str, Any] | None:
    if found is None:
        return None
    listed = zip(found.owners, found.names, strict=True)
    return {
        "parameters": [{"of": owner, "name": name} for owner, name in listed],
        "matrix": found.matrix.tolist(),
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


def _contributions_record(found: Contributions | None) -> dict[str, Any] | None:
    """Return what each cause changes, in numbers for each quantity of each measurement."""
    if found is None:
        return None
    return {"against": found.against, "data": [_account_record(a) for a in found.accounts]}


def _account_record(account: Account) -> dict[str, Any]:
    return {
        "measurement": account.measurement,
        "quantity": account.quantity,
        "unit": account.unit,
        "count": int(account.sd.size),
        "deviation": _term_record(account.deviation),
        "causes": {term.name: _term_record(term) for term in account.causes},
        "interaction": _term_record(account.interaction) | {"part": account.interaction_part},
        "remainder": _term_record(account.remainder),
    }


def _term_record(term: Term) -> dict[str, Any]:
    return {
        "rms": term.rms,
        "largest": term.largest,
        "largest_sigma": term.largest_sigma,
        "where": term.where,
    }


def write(diagnosis: Diagnosis, folder: str | Path) -> None:
    """Write `diagnosis.json` into a folder, which is made where it is missing.

    A diagnosis with causes also gets `contributions.csv`: what each of them changes of every datum,
    a row a datum.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ParameterError(
            f"{folder}: no folder can be made there ({error.strerror}); choose another with --out"
        ) from error
    text = json.dumps(json_value(record(diagnosis)), ensure_ascii=False, indent=1, allow_nan=False)
    write_text_whole(folder / "diagnosis.json", text)
    table = folder / TABLE
    found = diagnosis.contributions
    if found is None:
        table.unlink(missing_ok=True)  # that of an earlier diagnosis says nothing of this one
        return
    frame = found.to_dataframe()
    write_whole(table, lambda file: frame.to_csv(file, index=False, float_format=DIGITS))
