"""Fits of `femnl fit` to harmonic maps, all of a file with one amplitude."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

from femnl.cli._fixed import in_si
from femnl.cli._outcome import Outcome, record, show
from femnl.core.errors import ParameterError

if TYPE_CHECKING:
    import xarray as xr

    from femnl.cli._fit_kinds import FitOptions
    from femnl.core.device import Model
    from femnl.core.readout import PeriodicFringe

FRINGES = ("sine", "multilayer", "free")
# Of a fringe whose form is fitted too; enough for the reflection of a film above a wafer
OVERTONES = 5


def maps(named: Mapping[str, xr.Dataset], device: Model, options: FitOptions) -> dict[str, Outcome]:
    """Fit maps with the simulated shape of one mode."""
    from femnl.fits.map.fit import fit_map
    from femnl.mechanics.modes import shape_at
    from femnl.observe.map.forward import UNITS
    from femnl.pipeline import solve_modes
    from femnl.plot.mapfit import map_fit_figure

    index = options.mode
    fringe = options.fringe
    modes = solve_modes(device, max(10, index + 1), cache=options.cache)
    # The parameters of a single map go without its name.
    short = dict(named) if len(named) > 1 else {"": next(iter(named.values()))}
    fringes = {name: readout(fringe, device, dataset, FRINGES) for name, dataset in short.items()}
    known = {name: one for name, one in fringes.items() if one is not None} or None
    found = fit_map(
        short,
        lambda x, y: shape_at(modes, index, x, y),
        known,
        free_overtones=OVERTONES if fringe == "free" else 1,
        fixed=in_si(options.fixed, lambda name: "1" if "overtone" in name else UNITS.get(name)),
    )
    title = " and ".join(named)
    figures = {
        f"{name}-fit".strip("-"): partial(
            map_fit_figure, dataset, found.prediction[name], found.residual[name]
        )
        for name, dataset in short.items()
    }
    return {title: Outcome(record(found.fit), show(title, found.fit), figures)}


def readout(
    kind: str, device: Model, dataset: xr.Dataset, allowed: tuple[str, ...]
) -> PeriodicFringe | None:
    """Return the fringe of that name, None where it is a sine or its form is to be fitted."""
    from femnl.optics.fringe import MultilayerFringe

    if kind not in allowed:
        raise ParameterError(
            f"--fringe {kind}: a {dataset.attrs['kind']} takes one of {', '.join(allowed)}"
        )
    if kind != "multilayer":
        return None
    if device.stack is None:
        raise ParameterError(
            f"{device.name}: its geometry gives no [readout] gap, which the multilayer fringe "
            "needs; use --fringe sine"
        )
    if "wavelength" not in dataset.attrs:
        raise ParameterError(
            f"--fringe {kind}: the {dataset.attrs['kind']} has no attribute wavelength; add it"
        )
    return MultilayerFringe(device.stack, float(dataset.attrs["wavelength"]))
