"""Fit all devices of a chip together."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femnl.chip.alone import explained
from femnl.chip.causes import name_causes
from femnl.chip.film import fit_film
from femnl.chip.hierarchy import Hierarchy
from femnl.chip.members import Chip, Member, Number
from femnl.chip.mixture import Mixture
from femnl.chip.outliers import Cleaned, clean
from femnl.chip.result import ChipFit, Deviation, LeftOut, Quantity
from femnl.chip.values import LEAST_SD, Values
from femnl.core.errors import ParameterError
from femnl.core.fit import Parameter

Mask = NDArray[np.bool_]
MOST_LISTED = 6
"""Frequencies that a note lists."""
FEWEST = 4
"""Devices of one quantity that a fit needs."""


@dataclass(frozen=True)
class Entries:
    """The numbers of a chip in the order of `Values`. rows: device and mode of each."""

    values: Values
    rows: tuple[tuple[Member, str], ...]
    groups: tuple[tuple[str, str], ...]


def fit_chip(chip: Chip) -> ChipFit:
    """Fit frequencies and quality factors of all devices of a chip.

    See `femnl.chip.hierarchy` for the model, and `femnl.chip.outliers` for devices that deviate.

    Raises: ParameterError where fewer than four devices have a frequency, or none is like another.
    """
    entries = entries_of(chip, {m.name: m.frequency for m in chip.members})
    if len(np.unique(entries.values.device)) < FEWEST:
        raise ParameterError(
            f"chip {chip.name}: fewer than {FEWEST} devices have a frequency; add devices"
        )
    if not _compares_devices(entries.values):
        raise ParameterError(
            f"chip {chip.name}: no two devices share a design and a mode, so none can be compared; "
            "state the designs, or add devices"
        )
    cleaned = clean(entries.values)
    frequency = _quantity("frequency", "Hz", entries, cleaned)
    quality = None
    rated = [m for m in chip.members if m.quality]
    of_quality = entries_of(chip, {m.name: m.quality for m in rated})
    if len(rated) >= FEWEST and _compares_devices(of_quality.values):
        quality = _quantity("quality factor", "1", of_quality, clean(of_quality.values))
    film = fit_film(chip, entries, cleaned) if chip.geometries else None
    causes = tuple(
        explained(cause, chip, frequency, cleaned.model)
        for cause in name_causes(entries, cleaned, frequency, quality)
    )
    notes = list(chip.notes)
    alone = [
        f"{member.name} {mode}"
        for (member, mode), seen in zip(
            entries.rows, _comparable(entries.values, cleaned), strict=True
        )
        if not seen
    ]
    if alone:
        listed = ", ".join(alone[:MOST_LISTED]) + (", …" if len(alone) > MOST_LISTED else "")
        notes.append(f"modes that no ordinary device has as well are compared with none: {listed}")
    if not np.isfinite(entries.values.place).all():
        notes.append("places: not known of all devices, so no variation over the chip is sought")
    return ChipFit(
        chip.name,
        len(chip.members),
        chip.unit,
        frequency,
        quality,
        causes,
        film,
        tuple(notes),
    )


def _compares_devices(values: Values) -> bool:
    """Whether some group has two devices: one of each says nothing of how devices scatter."""
    return len(values.groups) < len(values.y)


def entries_of(chip: Chip, numbers: Mapping[str, Mapping[str, Number]]) -> Entries:
    """Return the logarithms of one quantity; numbers: by device and mode.

    Places are kept if those of all devices of the chip are known: the model is of one kind for
    every subset of the devices.
    """
    rows = [(m, mode) for m in chip.members for mode in numbers.get(m.name, {})]
    groups = sorted({(m.design, mode) for m, mode in rows})
    group_number = {group: k for k, group in enumerate(groups)}
    devices = {m.name: k for k, m in enumerate(chip.members)}
    placed = np.isfinite([m.place for m in chip.members]).all()
    places = [m.place if placed else (np.nan, np.nan) for m, _ in rows]
    read = [numbers[m.name][mode] for m, mode in rows]
    values = Values(
        y=np.log([n.value for n in read]),
        sd=np.array([max(n.sd / n.value, LEAST_SD) for n in read]),
        device=np.array([devices[m.name] for m, _ in rows], int),
        group=np.array([group_number[m.design, mode] for m, mode in rows], int),
        place=np.array(places, float).reshape(-1, 2),
    )
    return Entries(values.bounded(), tuple(rows), tuple(groups))


def _quantity(name: str, unit: str, entries: Entries, cleaned: Cleaned) -> Quantity:
    model = cleaned.model
    values = entries.values
    predicted = _predicted(values, cleaned)
    compared = _comparable(values, cleaned)
    devices = tuple(
        Deviation(
            member.name,
            mode,
            member.design,
            member.place,
            float(np.exp(values.y[k])),
            float(np.exp(predicted.mean[k])),
            float(values.y[k] - predicted.mean[k]),
            float(predicted.sd[k]),
            cleaned.outliers.get(int(values.device[k]), 0.0),
        )
        for k, (member, mode) in enumerate(entries.rows)
        if compared[k]
    )
    places = np.unique(model.values.place, axis=0)
    field = model.over_chip(places).mean if len(model.fields) > 1 else np.zeros(1)
    return Quantity(
        name=name,
        unit=unit,
        fields={f: model.probability(f) for f in model.fields},
        slope=_slope(model) if len(model.fields) > 1 else None,
        peak_to_valley=float(np.ptp(field)),
        spread=Parameter("spread", *model.spread(), "1"),
        means=_means(entries, model),
        devices=devices,
        left_out=_left_out(values, predicted),
    )


def _comparable(values: Values, cleaned: Cleaned) -> Mask:
    """Return which entries (n,) have others of their group, of devices that are no outliers."""
    alike = ~np.isin(values.device, [*cleaned.outliers])
    return np.array(
        [
            bool(np.any(alike & (values.group == group) & (values.device != device)))
            for group, device in zip(values.group, values.device, strict=True)
        ]
    )


def _predicted(values: Values, cleaned: Cleaned) -> Mixture:
    """Predict each entry by all devices that are no outliers, but its own."""
    alike = ~np.isin(values.device, [*cleaned.outliers])
    kept = cleaned.model.left_out
    shape = (len(cleaned.model.weights), len(values.y))
    weights, means, variances = (np.empty(shape) for _ in range(3))
    weights[:, alike] = kept.weights
    means[:, alike] = kept.means
    variances[:, alike] = kept.variances
    if not alike.all():
        other = cleaned.model.predict(values.only(~alike))
        weights[:, ~alike] = other.weights
        means[:, ~alike] = other.means
        variances[:, ~alike] = other.variances
    return Mixture(weights, means, variances)


def _left_out(values: Values, predicted: Mixture) -> LeftOut:
    """Return how well entries are predicted that others of their group can predict."""
    off = np.abs(values.y - predicted.mean)
    plain = np.full(len(values.y), np.nan)
    for k in range(len(plain)):
        others = (values.group == values.group[k]) & (values.device != values.device[k])
        if others.any():
            plain[k] = abs(values.y[k] - values.y[others].mean())
    known = np.isfinite(plain)
    if not known.any():
        return LeftOut(np.nan, np.nan, np.nan, 0)
    return LeftOut(
        float(np.median(off[known])),
        float(np.median(plain[known])),
        float(np.mean(off[known] < predicted.sd[known])),
        int(known.sum()),
    )


def _slope(model: Hierarchy) -> tuple[Parameter, ...]:
    """Return the gradient of the variation in the middle of the chip, along what devices span."""
    step = 0.1 * model.scale
    found = []
    for axis, name in enumerate("xy"):
        if np.ptp(model.values.place[:, axis]) == 0:
            continue
        back = model.centre[None].copy()
        ahead = back.copy()
        back[0, axis] -= step
        ahead[0, axis] += step
        number = model.expected(model.variation(ahead, back))
        found.append(
            Parameter(
                name, float(number.mean[0] / (2 * step)), float(number.sd[0] / (2 * step)), "1"
            )
        )
    return tuple(found)


def _means(entries: Entries, model: Hierarchy) -> dict[str, Parameter]:
    """Return what a device of each design and mode would have in the middle of the chip."""
    known = [k for k in range(len(entries.groups)) if k in model.values.groups]
    centre = np.tile(model.centre, (len(known), 1))
    group = np.array(known)
    where = Values(np.zeros(len(known)), np.zeros(len(known)), -1 - group, group, centre)
    means = model.expected(model.features(where))
    logarithm = model.reference(where) + means.mean
    return {
        " ".join(entries.groups[k]): Parameter(
            " ".join(entries.groups[k]),
            float(np.exp(mean)),
            float(np.exp(mean) * sd),
            "",
        )
        for k, mean, sd in zip(known, logarithm, means.sd, strict=True)
    }
