"""A part: from its file to a checked solid with mass properties, hull and frames."""
