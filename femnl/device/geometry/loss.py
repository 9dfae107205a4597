"""The table of what the film's material loses."""

from functools import partial
from typing import Annotated, Self

from pydantic import BeforeValidator, Field, model_validator

from femnl.core.loss import Loss
from femnl.device.geometry.quantities import Dimension, refusal, to_si
from femnl.device.geometry.tables import Table

PER_LENGTH = Dimension("a quality factor per thickness", "m^-1", "6e10 m^-1", 1.0, 1e20)
PerLength = Annotated[float, BeforeValidator(partial(to_si, dimension=PER_LENGTH))]
Quality = Annotated[float, Field(ge=1, le=1e12)]


class LossTable(Table):
    """Quality factors of the film's volume and surface; see core.device.Loss.

    What is left out is that of silicon nitride.
    """

    volume: Quality | None = None
    surface: PerLength | None = None
    surface_error: PerLength | None = None

    @model_validator(mode="after")
    def _has_a_value_with_its_error(self) -> Self:
        if self.surface_error is not None and self.surface is None:
            raise refusal(
                'it is the error of surface, which is missing; write e.g. surface = "6e10 m^-1"',
                "surface_error",
            )
        if self.surface is not None and (self.surface_error or 0.0) >= self.surface:
            raise refusal(
                "expected less than surface itself, or the loss has no upper bound",
                "surface_error",
            )
        return self

    def loss(self) -> Loss:
        """Return the numbers, an error of 0 where a surface is given without one."""
        usual = Loss()
        volume = usual.volume if self.volume is None else self.volume
        if self.surface is None:
            return Loss(volume)
        return Loss(volume, self.surface, self.surface_error or 0.0)
