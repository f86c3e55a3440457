"""The contents of a user's own folder, the tasks that fit it, and the commands for them: :func:`inspect`."""

from sextant.tools.inspection.inspecting import Inspection, inspect
from sextant.tools.inspection.summary import summary

__all__ = ["Inspection", "inspect", "summary"]
