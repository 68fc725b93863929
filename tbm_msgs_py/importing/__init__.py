"""Import of measurements from files of other systems: a description says what a column is, nothing is guessed."""

from tbm_msgs_py.importing.convert import Imported, ImportedStream, import_recording
from tbm_msgs_py.importing.description import Description, describe

__all__ = ["Description", "Imported", "ImportedStream", "describe", "import_recording"]
