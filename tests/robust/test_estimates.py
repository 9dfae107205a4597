"""What a mesh will need is foreseen before it is made, to within a factor that decides nothing."""

import pytest

from femnl.errors import ParameterError
from femnl.fem.memory import need_memory
from femnl.geometry import load
from femnl.mesh import build


@pytest.mark.parametrize(
    ("name", "symmetry", "resolution"),
    [("circle", "full", 2), ("square-270um", "full", 1), ("trampoline", "full", 1), ("trampoline", "full", 3)],
)
def test_the_number_of_triangles_is_foreseen(name: str, symmetry: str, resolution: float, monkeypatch: pytest.MonkeyPatch) -> None:
    foreseen = []

    def noted(amount: float, what: str, remedy: str) -> None:
        foreseen.append(amount / build.BYTES)
        need_memory(amount, what, remedy)

    monkeypatch.setattr(build, "need_memory", noted)
    made = build.mesh(load(name), symmetry, resolution).mesh.nelements
    assert 0.6 < foreseen[0] / made < 1.6


def test_what_fits_is_let_through_and_what_does_not_names_size_and_remedy() -> None:
    need_memory(1e6, "ten modes", "ask for fewer")
    with pytest.raises(ParameterError, match=r"^ten modes need about 90,949 GiB of memory, and this machine has .* GiB; ask for fewer$"):
        need_memory(1e5 * 2**30 * 0.909494702, "ten modes", "ask for fewer")
