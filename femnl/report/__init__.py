"""The validation report: one HTML page that needs nothing but a browser."""

from femnl.report.published import DEVICES, Device, Drive, Published
from femnl.report.write import write_device, write_report

__all__ = ["DEVICES", "Device", "Drive", "Published", "write_device", "write_report"]
