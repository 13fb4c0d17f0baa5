"""ROS messages through CDR and as plain data that can be compared, and as rosbags reads them."""

import dataclasses

from rclpy.serialization import deserialize_message, serialize_message
from rosbags.rosbag2 import Reader


def over_the_wire(message):
    """Return a message after it was serialised and read again."""
    return deserialize_message(serialize_message(message), type(message))


def bag_messages(folder):
    """Return what rosbags reads of a log: topic, log time and bytes of each message."""
    with Reader(folder) as reader:
        return [(each.topic, at, bytes(raw)) for each, at, raw in reader.messages()]


def plain(value):
    """Turn a message of rclpy or of rosbags into lists, tuples and strings of full precision."""
    if hasattr(value, 'get_fields_and_field_types'):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if dataclasses.is_dataclass(value):
        # rosbags gives constants as fields, and the name of the type.
        names = {field.name for field in dataclasses.fields(value)} - {'__msgtype__'}
        return {name: plain(getattr(value, name)) for name in names if name.islower()}
    if hasattr(value, 'tolist'):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    if isinstance(value, float):
        return value.hex()  # one NaN is as good as another
    return value
