"""The messages of camera_simulator."""

import array

import numpy as np
from geometry_msgs.msg import Quaternion, TransformStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from resting_aspects_interfaces.msg import Detection
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from resting_aspects_ros.arrays import Bytes
from resting_aspects_ros.feeding.tray_simulation import VirtualFeeder
from resting_aspects_ros.ros.callbacks import advertise
from resting_aspects_ros.ros.interface import LATCHED
from resting_aspects_ros.vision.outline import Outline
from resting_aspects_ros.vision.tray_image import TrayCamera

# Absolute: tf2 expects this name.
STATIC_TRANSFORMS = '/tf_static'


def image_msg(image: Bytes, header: Header) -> Image:
    """Return the message for a grey image (height, width)."""
    height, width = image.shape
    message = Image(header=header, height=height, width=width, encoding='mono8', step=width)
    message.data = array.array('B', image.tobytes())
    return message


def camera_info_msg(camera: TrayCamera, header: Header) -> CameraInfo:
    """Return the message for a camera.

    A telecentric camera has no centre of projection. The message is that of a pinhole camera 1 m
    above the surface, which has the same image of the surface.
    """
    (width, height), (u, v), scale = camera.size, camera.centre, camera.scale
    matrix = [scale, 0.0, u, 0.0, scale, v, 0.0, 0.0, 1.0]
    return CameraInfo(
        header=header,
        width=width,
        height=height,
        distortion_model='plumb_bob',
        d=[0.0] * 5,
        k=matrix,
        r=np.eye(3).ravel().tolist(),
        p=[scale, 0.0, u, 0.0, 0.0, scale, v, 0.0, 0.0, 0.0, 1.0, 0.0],
    )


def camera_transform(tray: str, camera: str) -> TransformStamped:
    """Return the pose of the optical frame of the camera, 1 m above the centre of the tray.

    z points down to the tray, x is that of the tray, and y of the tray points up in the image.
    """
    transform = TransformStamped(header=Header(frame_id=tray), child_frame_id=camera)
    transform.transform.translation.z = 1.0
    transform.transform.rotation = Quaternion(x=1.0, y=0.0, z=0.0, w=0.0)
    return transform


def publish_static_transform(node: Node, transform: TransformStamped) -> Publisher | None:
    """Publish a transform on /tf_static for late subscribers, too; return its publisher.

    Returns None if tf2 is not installed, so that there can be no listener on this machine.
    """
    try:
        from tf2_msgs.msg import TFMessage
    except ImportError:
        node.get_logger().info(f'tf2_msgs is not installed: {STATIC_TRANSFORMS} is not published')
        return None
    output = advertise(node, TFMessage, STATIC_TRANSFORMS, LATCHED)
    output.publish(TFMessage(transforms=[transform]))
    return output


def seen_centre(detection: Detection, outline: Outline) -> tuple[float, float]:
    """Return where a detection has the centroid of its outline, tray frame, m."""
    cos, sin = np.cos(detection.yaw), np.sin(detection.yaw)
    x, y = outline.centroid
    return float(detection.x + cos * x - sin * y), float(detection.y + sin * x + cos * y)


def missing_text(output: Publisher, needed: int) -> str:
    """Return how many subscribers of a publisher there are, if more are needed; else ''."""
    found = output.get_subscription_count()
    return (
        '' if found >= needed else f'waiting for {needed} subscribers of {output.topic}: {found}'
    )


def feeder_values(feeder: VirtualFeeder) -> dict[str, object]:
    """Return the values of a feeder for the diagnostics."""
    return {
        'simulated seconds': f'{feeder.seconds:.1f}',
        'parts on the tray': len(feeder.tray.classes),
        'picks': feeder.picks,
        'supplied': feeder.supplied,
    }
