"""What a request will need, said before it starts."""

import os

from femnl.errors import ParameterError


def need_memory(amount: float, what: str, remedy: str) -> None:
    """Refuse what cannot fit, before hours are spent on it.

    Args: amount: estimate of the memory needed [bytes]. what: needs it, in the plural. remedy: the knob to turn.
    Raises: ParameterError where it is more than the memory of the machine.
    """
    machine = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if amount > machine:
        raise ParameterError(f"{what} need about {_gib(amount)} of memory, and this machine has {_gib(machine)}; {remedy}")


def _gib(amount: float) -> str:
    size = amount / 2**30
    return f"{size:.2g} GiB" if size < 10 else f"{size:,.0f} GiB"
