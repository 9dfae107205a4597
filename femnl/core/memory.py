"""What a request will need, said before it starts."""

import os
import resource
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from femnl.core.errors import ParameterError

LIMITS = (resource.RLIMIT_AS, resource.RLIMIT_DATA, resource.RLIMIT_RSS)
"""What a shell (`ulimit -v`, `-d`, `-m`) or a batch system allows a process."""
SYSTEM = Path("/")
"""Where Linux shows what a container or a batch system allows a group of processes."""


def need_memory(amount: float, what: str, remedy: str) -> None:
    """Refuse what cannot fit, before hours are spent on it.

    Args: amount: estimate of the memory needed [bytes]. what: needs it, in the plural. remedy: the
    setting to turn.
    Raises: ParameterError where it is more than the memory of the machine, or than this process may
    take of it.
    """
    allowed = allowed_memory(SYSTEM)
    if amount > allowed:
        whose = "this process may take" if allowed < _machine() else "this machine has"
        raise ParameterError(
            f"{what} need about {_gib(amount)} of memory, and {whose} {_gib(allowed)}; {remedy}"
        )


def allowed_memory(system: Path) -> int:
    """Return what this process may take [bytes]: no more than the machine has.

    Args: system: the root of the file system.
    """
    return min([_machine(), *_limits_of_process(), *limits_of_groups(system)])


def _machine() -> int:
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def _limits_of_process() -> list[int]:
    limits = [resource.getrlimit(kind)[0] for kind in LIMITS]
    return [limit for limit in limits if limit != resource.RLIM_INFINITY]


def limits_of_groups(system: Path) -> Iterator[int]:
    """Yield the limits [bytes] of the control groups that this process is in.

    Those of its own group and of all above it, of versions 1 and 2. In a container the path may be
    that of the host, of which the container sees the last group alone, as the root.

    Args: system: the root of the file system.
    Source: cgroups(7); Linux, Documentation/admin-guide/cgroup-v2.rst, memory.max.
    """
    try:
        lines = (system / "proc/self/cgroup").read_text(encoding="utf-8").splitlines()
    except OSError:  # another system than Linux
        return
    mounted = system / "sys/fs/cgroup"
    for line in lines:
        _, controllers, path = line.split(":", 2)
        if not controllers:
            trees = [(mounted, "memory.max"), (mounted / "unified", "memory.max")]
        elif "memory" in controllers.split(","):
            trees = [(mounted / "memory", "memory.limit_in_bytes")]
        else:
            continue
        own = Path(path.strip("/"))
        for tree, name in trees:
            for group in (own, *own.parents):
                # A group without a limit has no such file, or says "max" in it
                with suppress(OSError, ValueError):
                    yield int((tree / group / name).read_text(encoding="utf-8"))


def _gib(amount: float) -> str:
    size = amount / 2**30
    return f"{size:.2g} GiB" if size < 10 else f"{size:,.0f} GiB"
