"""The vision_example node: finds the parts in images of a tray with a backlight."""

import sys
from typing import Any

import cv2
import numpy as np
from geometry_msgs.msg import Point32, Polygon
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.qos import QoSProfile
from resting_aspects_interfaces.msg import Detection, DetectionArray, Status
from resting_aspects_interfaces.srv import IdentifyPart
from sensor_msgs.msg import CameraInfo, Image

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.errors import InvalidValueError, RestingAspectsError, shown
from resting_aspects_ros.nodes.vision_example.contours import Blob, clearances, find_blobs
from resting_aspects_ros.ros.callbacks import advertise, subscribe, wait_for
from resting_aspects_ros.ros.interface import CELL, DETECTIONS, IDENTIFY_PART, SERVICES
from resting_aspects_ros.ros.program import FRAME_ID, Parameter, check_frame, declare, run_node
from resting_aspects_ros.vision.camera import Telecentric

IMAGE, CAMERA_INFO, ANNOTATED = 'camera/image_raw', 'camera/camera_info', 'camera/image_annotated'
# Reliable, so that no image is lost. For a camera that publishes as best effort, override it.
IMAGES = QoSProfile(depth=2)
PARAMETERS = (
    Parameter('part', 'l_bracket', 'name of the part on the tray; empty: any part of the suite'),
    Parameter('level', 127.5, 'grey value of an edge, between part and light', (1.0, 254.0)),
    Parameter('min_area', 1.0, 'minimum area of a part or a hole, mm^2', (0.0, 1e6)),
    FRAME_ID,
)
# Of all answers to an image, s. A service that was restarted does not answer.
TIMEOUT = 10.0
# Conversions to grey of the encodings of images that are not grey.
CONVERSIONS = {'bgr8': cv2.COLOR_BGR2GRAY, 'rgb8': cv2.COLOR_RGB2GRAY}
COLOURS = ((230, 60, 40), (30, 110, 230), (20, 160, 60), (200, 120, 0), (150, 60, 200))


class VisionExample(Node):
    """Publishes detections, and camera/image_annotated if there is a subscriber.

    Subscribes to camera/image_raw (mono8, bgr8 or rgb8; dark parts on a backlight) and to
    camera/camera_info, whose matrix K maps the surface of the tray at a distance of 1 m to pixels.
    Uses the service identify_part.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__('vision_example', **options)
        self._settings = declare(self, PARAMETERS)
        check_frame(self._settings['frame_id'])
        group = ReentrantCallbackGroup()
        self._identify = self.create_client(
            IdentifyPart, IDENTIFY_PART, qos_profile=SERVICES, callback_group=group
        )
        self._output = advertise(self, DetectionArray, DETECTIONS, CELL, overridable=True)
        self._annotated = advertise(self, Image, ANNOTATED, IMAGES, overridable=True)
        self._camera: Telecentric | None = None
        self._number, self._stamp, self._busy = 0, None, False
        subscribe(self, CameraInfo, CAMERA_INFO, self._on_camera_info, IMAGES, overridable=True)
        subscribe(self, Image, IMAGE, self._on_image, IMAGES, overridable=True, group=group)
        self.get_logger().info(f'ready: waiting for {self.resolve_topic_name(IMAGE)}')

    def _on_camera_info(self, message: CameraInfo) -> None:
        self._camera = camera_from(message)

    async def _on_image(self, message: Image) -> None:
        if self._busy:
            return  # the image of a camera that is faster than the identification
        if self._camera is None:  # the first image can overtake its camera_info
            self.get_logger().warning(
                f'ignored images: {self.resolve_topic_name(CAMERA_INFO)} has not arrived',
                throttle_duration_sec=TIMEOUT,
                skip_first=True,
            )
            return
        if not self._identify.service_is_ready():  # a request would be lost
            raise RestingAspectsError(f'{IDENTIFY_PART} is not available: start the suite')
        self._busy, answers = True, []
        try:
            image, to_tray = grey_image(message), self._camera.to_tray
            scale = np.linalg.norm(np.subtract(*to_tray([[0, 0], [1, 0]]))) * 1000  # mm/px
            blobs = find_blobs(
                image, self._settings['level'], self._settings['min_area'] / scale**2
            )
            outers = [to_tray(blob.outer) for blob in blobs]
            free = clearances([to_tray(blob.boundary) for blob in blobs])
            # All requests are sent before the first response is awaited.
            answers += [self._identify.call_async(self._request(blob, to_tray)) for blob in blobs]
            for answer in answers:
                if not await wait_for(self, answer, TIMEOUT):
                    raise RestingAspectsError(f'{IDENTIFY_PART} has not answered')
            found = [
                detection(answer.result(), outer, clearance)
                for answer, outer, clearance in zip(answers, outers, free.tolist(), strict=True)
            ]
        finally:
            self._busy = False
            for answer in answers:  # otherwise those that never arrive would accumulate
                self._identify.remove_pending_request(answer)
        if message.header.stamp != self._stamp:
            self._number, self._stamp = self._number + 1, message.header.stamp
        output = DetectionArray(image=self._number, detections=found)
        output.header.stamp = message.header.stamp  # the time of the exposure
        output.header.frame_id = self._settings['frame_id']
        self._output.publish(output)
        if self._annotated.get_subscription_count():
            self._annotated.publish(annotated(message, image, blobs, found))

    def _request(self, blob: Blob, to_tray: Any) -> IdentifyPart.Request:
        part = self._settings['part']
        return IdentifyPart.Request(
            outer=polygon_msg(to_tray(blob.outer)),
            holes=[polygon_msg(to_tray(hole)) for hole in blob.holes],
            parts=[part] if part else [],
        )


def camera_from(message: CameraInfo) -> Telecentric:
    """Return the camera of which K is the matrix for points of the surface at a distance of 1 m.

    The camera looks down, so that x is to the right in the image, and y is up.
    """
    matrix = np.reshape(message.k, (3, 3)) @ np.diag([1.0, -1.0, 1.0])
    if not np.isfinite(matrix).all() or abs(np.linalg.det(matrix)) < 1e-6:
        raise InvalidValueError(f'invalid K {shown(message.k.tolist())}: expected a camera matrix')
    return Telecentric(np.linalg.inv(matrix))


def grey_image(message: Image) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """Return the grey image (height, width) in a message; raises InvalidValueError."""
    channels = 3 if message.encoding in CONVERSIONS else 1
    if channels == 1 and message.encoding != 'mono8':
        raise InvalidValueError(
            f'invalid encoding {shown(message.encoding)}: expected mono8, bgr8 or rgb8'
        )
    height, width = message.height, message.width
    size = height * message.step
    if message.step < channels * width or len(message.data) != size or not height * width:
        raise InvalidValueError(
            f'invalid image of {len(message.data)} bytes: expected {height} rows of '
            f'{message.step} bytes, for {width} pixels each'
        )
    rows = np.frombuffer(message.data, np.uint8).reshape(height, message.step)
    pixels = rows[:, : channels * width].reshape(height, width, channels)
    if channels == 1:
        return pixels[:, :, 0]
    return np.asarray(cv2.cvtColor(pixels, CONVERSIONS[message.encoding]))


def polygon_msg(points: Array) -> Polygon:
    """Return the message for points (n, 2)."""
    return Polygon(points=[Point32(x=x, y=y) for x, y in points.tolist()])


def detection(answer: IdentifyPart.Response, outer: Array, clearance: float) -> Detection:
    """Return what was identified in an outline (n, 2), m.

    Raises RestingAspectsError if nothing can be identified yet.
    """
    x, y = outer.mean(axis=0).tolist()
    found = Detection(x=x, y=y, clearance=clearance)
    if answer.status.code == Status.INVALID:
        return found  # not recognised, as the outline is not valid
    if answer.status.code != Status.OK:
        raise RestingAspectsError(f'{IDENTIFY_PART} has no answer: {answer.status.message}')
    best, touching = answer.candidates[0], answer.touching_probability
    if 1 - answer.none_probability - touching >= max(answer.none_probability, touching):
        found.part, found.class_id = best.part, str(best.symmetry_class)
        found.score, found.x, found.y, found.yaw = best.posterior, best.x, best.y, best.yaw
    elif touching > answer.none_probability:
        found.part, found.score = best.part, touching  # parts that touch have no class
    return found


def annotated(message: Image, grey: Any, blobs: list[Blob], found: list[Detection]) -> Image:
    """Return the image with the outlines and their classes."""
    picture = cv2.cvtColor(grey, cv2.COLOR_GRAY2RGB)
    for blob, each in zip(blobs, found, strict=True):
        colour = COLOURS[int(each.class_id) % len(COLOURS)] if each.class_id else (120, 120, 120)
        rings = [np.rint(ring).astype(np.int32) for ring in (blob.outer, *blob.holes)]
        cv2.polylines(picture, rings, True, colour, 2)
        text, place = each.class_id or '?', tuple(rings[0].mean(axis=0).astype(int).tolist())
        cv2.putText(picture, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.8, (255, 255, 0), 2)
    height, width, _ = picture.shape
    output = Image(height=height, width=width, encoding='rgb8', step=3 * width)
    output.header, output.data = message.header, picture.tobytes()
    return output


def main() -> int:
    """Run the node in a process of its own."""
    return run_node(VisionExample, PARAMETERS)


if __name__ == '__main__':
    sys.exit(main())
