"""What VTK can draw on here, found out in a process of its own.

Without a usable OpenGL it ends the process that asks.
"""

import os
import subprocess
import sys
from functools import cache

from femnl.core.errors import MissingLibraryError

OFFSCREEN = ("vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow")
WINDOW = ("vtkXOpenGLRenderWindow",)
CHOICE = "VTK_DEFAULT_OPENGL_WINDOW"
PROBE = """
import sys
import vtkmodules.vtkRenderingOpenGL2
from vtkmodules.vtkRenderingCore import vtkRenderWindow
window = vtkRenderWindow()
if window.GetClassName() != sys.argv[1]:
    sys.exit(3)
window.SetOffScreenRendering(1)
window.SetSize(8, 8)
window.Render()
sys.exit(0 if window.SupportsOpenGL() else 4)
"""
SECONDS = 60


def need_offscreen() -> None:
    """Make VTK draw without a display, through EGL or OSMesa.

    Raises: MissingLibraryError where neither works.
    """
    os.environ[CHOICE] = _first_usable(
        OFFSCREEN,
        "pictures need OpenGL without a display; neither EGL nor OSMesa works here: install one "
        "(Debian: apt-get install libegl1)",
    )


def need_window() -> None:
    """Make VTK draw in a window. Raises: MissingLibraryError where no X display answers."""
    os.environ[CHOICE] = _first_usable(
        WINDOW,
        "no X display with OpenGL answers here; name a file to draw into instead (--out FILE.png)",
    )


@cache
def _first_usable(windows: tuple[str, ...], advice: str) -> str:
    for name in windows:
        probe = subprocess.run(
            [sys.executable, "-c", PROBE, name],
            env=os.environ | {CHOICE: name},
            capture_output=True,
            timeout=SECONDS,
            check=False,
        )
        if probe.returncode == 0:
            return name
    raise MissingLibraryError(advice)
