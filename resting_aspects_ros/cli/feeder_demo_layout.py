"""The Foxglove layout of a feeder, with the topics of a part in a namespace."""

import json
from pathlib import Path
from typing import Any

from resting_aspects_ros.api.output_files import whole_file
from resting_aspects_ros.simulation.conditions import config_folder

# The part and the topics of the shipped layout; topics outside the namespace remain.
SHIPPED_PART, GLOBAL = 'l_bracket', ('/diagnostics',)


def save_layout(path: Path, part: str, namespace: str) -> str:
    """Write the layout, and return how to watch the nodes."""
    with whole_file(path) as file:
        file.write_text(foxglove_layout(part, namespace), encoding='utf-8')
    return (
        f'To watch it: the layout {path} for Foxglove, or '
        f'rviz2 -d rviz/feeder.rviz --ros-args -r __ns:={namespace}'
    )


def foxglove_layout(part: str, namespace: str = '/') -> str:
    """Return the shipped layout as JSON, with its topics for a part and a namespace."""
    text = (config_folder() / 'foxglove' / 'feeder.json').read_text(encoding='utf-8')
    prefix = '/' + namespace.strip('/') if namespace.strip('/') else ''

    def changed(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: changed(each) for key, each in value.items()}
        if isinstance(value, list):
            return [changed(each) for each in value]
        if not isinstance(value, str) or not value.startswith('/') or value in GLOBAL:
            return value
        topic, dot, field = value.partition('.')
        head, slash, name = topic.rpartition('/')
        topic = f'{head}{slash}{part}' if name == SHIPPED_PART else topic
        return f'{prefix}{topic}{dot}{field}'

    return json.dumps(changed(json.loads(text)), indent=2) + '\n'
