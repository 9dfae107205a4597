"""The validation report: one HTML page that needs nothing but a browser."""

from typing import TYPE_CHECKING

from femnl.core.lazy import lazy_names

if TYPE_CHECKING:
    from femnl.report.published import DEVICES, Device, Drive, Published
    from femnl.report.write import write_device, write_report

__all__ = ["DEVICES", "Device", "Drive", "Published", "write_device", "write_report"]
# Only the page of a device needs the pictures of films, whose library takes half a second to load
_HOMES = {
    "DEVICES": "femnl.report.published",
    "Device": "femnl.report.published",
    "Drive": "femnl.report.published",
    "Published": "femnl.report.published",
    "write_device": "femnl.report.write",
    "write_report": "femnl.report.write",
}
__getattr__ = lazy_names(__name__, _HOMES)
