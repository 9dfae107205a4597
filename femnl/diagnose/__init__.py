"""Criticise the model of a measurement, name the cause of what it gets wrong, measure the gain."""

from femnl.diagnose.files import record, write
from femnl.diagnose.run import diagnose

__all__ = ["diagnose", "record", "write"]
