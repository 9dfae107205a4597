"""Responses along a line over the membrane, fitted position by position.

What depends on the readout's place, and what does not.
"""

from collections.abc import Mapping

import numpy as np
import xarray as xr

from femnl.core.choices import Use
from femnl.core.readout import Array
from femnl.fits.response.fit import fit_response

FIELDS = ("frequency", "linewidth", "alpha_ratio", "y_max", "alpha_y", "alpha_c")


def fit_line_scan(
    dataset: xr.Dataset,
    use: Use | None = None,
    *,
    nonlinear_damping: bool = False,
    fixed: Mapping[str, float] | None = None,
) -> xr.Dataset:
    """Fit each position of a `response` on its own, so that nothing forces them to agree.

    α_y follows 1/y_max² over the membrane, while α_y/α_c, and with it α, must not depend on the
    position.

    Args:
        dataset: of kind `response`, all sweeps of one mode.
        use: as in `fit_response`.
        nonlinear_damping: as in `fit_response`.
        fixed: as in `fit_response`, at every position; alpha_ratio is held at its drive.

    Returns:
        Dataset over `position` (in order of rising x, then y) with x, y [m], chi2_reduced, and
        value and `_sd` of frequency, linewidth, alpha_ratio at the strongest drive of all, y_max,
        alpha_y and alpha_c as far as `use` sees them; attributes alpha_ratio and alpha_ratio_sd,
        the weighted mean over positions, and scatter, χ²/(n − 1) of the positions about it.

    Raises:
        MeasurementError: a position whose sweeps cannot be fitted.
    Source: arXiv:2502.19191, figure 2 (b), (e), (f).
    """
    place = np.stack([_coordinate(dataset, "x"), _coordinate(dataset, "y")], axis=1)
    positions = np.unique(place, axis=0)
    fits = [
        fit_response(
            dataset.isel(sweep=np.all(place == p, axis=1)),
            use,
            duffing=True,
            nonlinear_damping=nonlinear_damping,
            fixed=fixed,
        )
        for p in positions
    ]
    out = xr.Dataset(
        coords={
            "x": ("position", positions[:, 0], {"units": "m"}),
            "y": ("position", positions[:, 1], {"units": "m"}),
        }
    )
    out["chi2_reduced"] = "position", [fit.chi2_reduced for fit in fits]
    strongest = max(fit["drive"] for fit in fits)
    for name in FIELDS:
        if name in fits[0].parameters:
            # α_y/α_c grows with the square of the drive: quote every position at the same one.
            power = [
                (strongest / fit["drive"]) ** 2 if name == "alpha_ratio" else 1.0 for fit in fits
            ]
            found = [fit.parameters[name] for fit in fits]
            out[name] = (
                "position",
                [p.value * factor for p, factor in zip(found, power, strict=True)],
                {"units": found[0].unit},
            )
            out[f"{name}_sd"] = (
                "position",
                [p.sd * factor for p, factor in zip(found, power, strict=True)],
                {"units": found[0].unit},
            )
    mean, sd, scatter = _mean(out["alpha_ratio"].values, out["alpha_ratio_sd"].values)
    out.attrs = {
        "alpha_ratio": mean,
        "alpha_ratio_sd": sd,
        "scatter": scatter,
        "drive": strongest,
    }
    return out


def _mean(values: Array, sd: Array) -> tuple[float, float, float]:
    """Return the weighted mean of values (n,), its sd, and χ²/(n − 1) about it.

    Values that were held have the sd 0, and so has their mean. Those whose sd is withheld (NaN)
    do not count; without any other, the mean has none, either.
    """
    if not sd.all():
        return float(values.mean()), 0.0, 0.0
    known = np.isfinite(sd)
    if not known.any():
        return float(values.mean()), np.nan, np.nan
    values = values[known]
    sd = sd[known]
    weight = 1 / sd**2
    mean = float(np.sum(weight * values) / np.sum(weight))
    scatter = float(np.sum(weight * (values - mean) ** 2) / max(len(values) - 1, 1))
    return mean, float(np.sum(weight) ** -0.5), scatter


def _coordinate(
    dataset: xr.Dataset, name: str
) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return np.asarray(
        dataset[name].values if name in dataset else np.zeros(dataset.sizes["sweep"]), dtype=float
    )
