"""What a request will need, said before it starts."""

import os
import resource

from femnl.core.errors import ParameterError

LIMITS = (resource.RLIMIT_AS, resource.RLIMIT_DATA, resource.RLIMIT_RSS)
"""What a shell (`ulimit -v`, `-d`, `-m`) or a batch system allows a process."""


def need_memory(amount: float, what: str, remedy: str) -> None:
    """Refuse what cannot fit, before hours are spent on it.

    Args: amount: estimate of the memory needed [bytes]. what: needs it, in the plural. remedy: the
    setting to turn.
    Raises: ParameterError where it is more than the memory of the machine, or than this process may
    take of it.
    """
    machine = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    allowed = min(
        [
            machine,
            *(
                limit
                for limit in (resource.getrlimit(kind)[0] for kind in LIMITS)
                if limit != resource.RLIM_INFINITY
            ),
        ]
    )
    if amount > allowed:
        whose = "this process may take" if allowed < machine else "this machine has"
        raise ParameterError(
            f"{what} need about {_gib(amount)} of memory, and {whose} {_gib(allowed)}; {remedy}"
        )


def _gib(amount: float) -> str:
    size = amount / 2**30
    return f"{size:.2g} GiB" if size < 10 else f"{size:,.0f} GiB"
