"""Calibrations to and from other formats: navdeck's JSON, ArduPilot's and PX4's parameter files, a C header."""

from server.calibration.errors import ExchangeError
from server.calibration.exchange.export import FORMATS, Exported, export_calibration
from server.calibration.exchange.parameters import Warned, read_parameters
from server.calibration.exchange.reading import Imported, import_calibration

__all__ = [
    "FORMATS",
    "ExchangeError",
    "Exported",
    "Imported",
    "Warned",
    "export_calibration",
    "import_calibration",
    "read_parameters",
]
