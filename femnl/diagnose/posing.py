"""From a measurement file to the model of what it holds, and the effects that may act there."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

import xarray as xr

from femnl.core.checkpoint import Checkpoint
from femnl.core.device import Model
from femnl.core.errors import MeasurementError
from femnl.core.kinds import function, kind_of
from femnl.diagnose.noise_of_file import Noise
from femnl.diagnose.pose_joint import pose_joint
from femnl.diagnose.sent import Sent, received
from femnl.diagnose.worker_pool import Posed
from femnl.io import measurement
from femnl.observe.film import SimulatedFilm
from femnl.observe.model import MeasurementModel
from femnl.observe.noisy import FoundNoise, with_noise
from femnl.pipeline import measured_device


@dataclass(frozen=True)
class Posing:
    """Poses the model of a file and its effects, under whatever noise was found.

    path, geometry: as `diagnose` takes them. chosen: effects, as `sent` returns them. What the file
    holds is read, and what poses a model is fitted, once in each process: noise does not enter it.
    """

    path: Path
    geometry: str | None
    chosen: list[Sent]
    _posed: dict[str, MeasurementModel] = field(default_factory=dict, compare=False, repr=False)

    def __call__(
        self,
        checkpoint: Checkpoint | None,
        *,
        noise: Noise | None = None,
        backwards: bool = False,
    ) -> Posed:
        """Return the model, and the effects that may explain its deviations.

        Args: noise: what was found of it, by measurement; a single one has no name. backwards: see
        `pose_joint`.
        """
        effects = [received(effect) for effect in self.chosen]
        found = noise or {}
        stated = self._stated(checkpoint)
        groups = {
            name: with_noise(bare, found.get("" if len(stated) == 1 else name, FoundNoise()))
            for name, bare in stated.items()
        }
        if len(groups) > 1:
            return pose_joint(groups, effects, backwards, checkpoint)
        (only,) = groups.values()
        return only, only.usable_effects(effects)

    def __reduce__(self) -> tuple[type[Self], tuple[Path, str | None, list[Sent]]]:
        """Leave out what each process poses itself."""
        return type(self), (self.path, self.geometry, self.chosen)

    def _stated(self, checkpoint: Checkpoint | None) -> dict[str, MeasurementModel]:
        """Return the models under the stated noise, by measurement."""
        if not self._posed:
            tree, device = opened(self.path, self.geometry)
            for name, node in tree.children.items():
                self._posed[name] = pose(name, node.to_dataset(), device, checkpoint)
        return self._posed


def opened(path: Path, geometry: str | None) -> tuple[xr.DataTree, Model | None]:
    """Read a measurement, and the device that it is of; a record of an oscillator needs none."""
    tree = measurement.read(path)
    groups = [node.to_dataset() for node in tree.children.values()]
    bare = (
        geometry is None
        and tree.attrs.keys().isdisjoint(("model", "geometry"))
        and not any(kind_of(group).needs_device for group in groups)
    )
    return tree, None if bare else measured_device(tree.attrs, path, geometry)


def pose(
    name: str, dataset: xr.Dataset, model: Model | None, checkpoint: Checkpoint | None = None
) -> MeasurementModel:
    """Return the model of a group of a measurement file, by its kind.

    Args: name: of the group. model: the device, None where no kind needs one. checkpoint: keeps the
    fits that this takes.
    Raises: MeasurementError for a kind that needs a device where there is none.
    """
    spec = kind_of(dataset)
    simulated = SimulatedFilm.for_spectra if spec.takes_layers else SimulatedFilm
    film = None if model is None else simulated(model, spec.modes(dataset))
    if film is None and spec.needs_device:
        raise MeasurementError(f"{name}: a {spec.name} needs a device; give it with --geometry")
    posed: MeasurementModel = function(spec.pose)(dataset, film, checkpoint)
    return posed
