"""Sums over the entries of each device of a chip, which are all that a Gaussian hierarchy needs."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from femnl.chip.values import Array, Integers, Values


@dataclass(frozen=True)
class Sums:
    """Sums over the entries of each device, or of several devices, for every pair of τ and κ.

    W is the inverse covariance of a device's entries without means and variation, U their features.

    information: UᵀWU, (pairs, devices, r, r). projection: UᵀWy, (pairs, devices, r). square: yᵀWy
    and log_determinant: ln|W|, (pairs, devices). count: entries, (devices,). Without the axis of
    the devices where they are summed over.
    """

    information: Array
    projection: Array
    square: Array
    log_determinant: Array
    count: Integers

    @cached_property
    def total(self) -> "Sums":
        """The sums over all devices."""
        return Sums(
            self.information.sum(axis=1),
            self.projection.sum(axis=1),
            self.square.sum(axis=1),
            self.log_determinant.sum(axis=1),
            self.count.sum(),
        )

    def without(self, device: int) -> "Sums":
        """Return the sums over all devices but one, by its place in the order."""
        total = self.total
        return Sums(
            total.information - self.information[:, device],
            total.projection - self.projection[:, device],
            total.square - self.square[:, device],
            total.log_determinant - self.log_determinant[:, device],
            total.count - self.count[device],
        )


def sums_of(values: Values, y: Array, features: Array, spread: Array, mode_spread: Array) -> Sums:
    """Return the sums over the entries of each device, in the order of their numbers.

    Args: y (n,): what is explained, counted from a reference. features (n, r): U. spread,
        mode_spread (pairs,): τ and κ.
    """
    devices = np.unique(values.device)
    shape = (len(spread), len(devices))
    r = features.shape[1]
    found = Sums(
        np.empty((*shape, r, r)),
        np.empty((*shape, r)),
        np.empty(shape),
        np.empty(shape),
        np.array([int((values.device == device).sum()) for device in devices]),
    )
    for n, device in enumerate(devices):
        own = values.device == device
        u = features[own]
        own_noise = mode_spread[:, None] ** 2 + values.sd[own] ** 2
        noise = own_noise[:, :, None] * np.eye(len(u)) + spread[:, None, None] ** 2
        inverse = np.linalg.inv(noise)
        found.information[:, n] = np.einsum("ia,kij,jb->kab", u, inverse, u)
        found.projection[:, n] = np.einsum("ia,kij,j->ka", u, inverse, y[own])
        found.square[:, n] = np.einsum("i,kij,j->k", y[own], inverse, y[own])
        found.log_determinant[:, n] = np.linalg.slogdet(inverse)[1]
    return found
