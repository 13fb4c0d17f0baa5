"""Read an observed outline from a JSON document."""

from pathlib import Path

import shapely

from resting_aspects_ros.api.inputs.json_document import file_text, parse_json
from resting_aspects_ros.core.errors import InvalidValueError, located
from resting_aspects_ros.core.input_file import read_input
from resting_aspects_ros.core.vision.observation import observed_polygon

MAX_BYTES = 1 << 24


def read_polygon(path: Path) -> shapely.Polygon:
    """Return the polygon of a document with outer and holes; raises InvalidValueError."""
    document = parse_json(path, read_input(path, MAX_BYTES, 'polygon'))
    if 'outlines' in document and 'outer' not in document:
        raise InvalidValueError(
            f'invalid --polygon {file_text(path)}: expected one outline with outer and holes; '
            'this is the document of resting_aspects outlines, whose list outlines has one for '
            'each class'
        )
    with located(file_text(path)):
        return observed_polygon(document)
