"""What the material of a film loses as it bends."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Loss:
    """What the film loses as it bends: 1/Q_int = 1/volume + 1/(surface h), h the thickness.

    volume: quality factor of the material without a surface. surface and surface_error [1/m]: β of
    Q_surf = βh and its standard deviation among films.

    The default is silicon nitride at room temperature: Villanueva and Schmid, Phys. Rev. Lett.
    113, 227201 (2014), who find β = (6 ± 4)·10¹⁰ m⁻¹, 6000 for 100 nm.
    """

    volume: float = 2.8e4
    surface: float = 6e10
    surface_error: float = 4e10

    def intrinsic(self, thickness: float) -> tuple[float, float, float]:
        """Return Q_int of a film [m], and the same for β one standard deviation less and more."""
        low, mean, high = (
            1 / (1 / self.volume + 1 / (surface * thickness))
            for surface in (
                self.surface - self.surface_error,
                self.surface,
                self.surface + self.surface_error,
            )
        )
        return mean, low, high
