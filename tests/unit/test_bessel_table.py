"""Tabulated Bessel functions against scipy's."""

import numpy as np
import pytest
from scipy.special import jv

from femnl.optics.bessel_table import NODES, SHORTEST, bessel_table


@pytest.mark.parametrize("orders", [(0,), (0, 1, 2, 7, 40), (1, 250)])
@pytest.mark.parametrize("reach", [1.0, SHORTEST, 33.0, 500.0])
def test_a_table_holds_bessel_functions_to_its_reach(reach: float, orders: tuple[int, ...]) -> None:
    table = bessel_table(orders, reach)
    assert len(table) / NODES >= reach
    nodes = np.arange(len(table)) / NODES
    assert np.abs(table[:, :, 0] - jv(orders, nodes[:, None])).max() < 1e-13
    middle = table @ [1, 0.5, 0.25, 0.125]
    assert np.abs(middle - jv(orders, nodes[:, None] + 0.5 / NODES)).max() < 1e-8


def test_a_longer_table_has_the_same_nodes() -> None:
    short = bessel_table((1, 3), 10.0)
    long = bessel_table((1, 3), 100.0)
    assert np.array_equal(short, long[: len(short)])


def test_a_motion_on_a_node_at_the_end_has_a_cubic() -> None:
    assert bessel_table((1,), float(SHORTEST)).shape[0] > SHORTEST * NODES
