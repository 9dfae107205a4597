"""`python -m femnl`, the same as the command `femnl`."""

from femnl.cli import main

main()
