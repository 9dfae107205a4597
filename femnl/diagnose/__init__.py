"""Criticise the base model of a measurement, name the cause of what it gets wrong, and measure the gain."""

from femnl.diagnose.run import diagnose, record, write

__all__ = ["diagnose", "record", "write"]
