"""What the vision system and the controller answer to an image."""

import time
from collections.abc import Callable
from typing import TypeVar

from builtin_interfaces.msg import Time
from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.msg import DetectionArray, FeederAdvice

from resting_aspects_ros.ros.callbacks import subscribe, wait_for
from resting_aspects_ros.ros.interface import CELL, DETECTIONS, FEEDER_ADVICE, LATCHED

Found = TypeVar('Found')


class Answers:
    """The newest detections and the newest advice for a part.

    advice : FeederAdvice or None
    """

    def __init__(self, node: Node, part: str) -> None:
        self._node = node
        self._topic = f'{FEEDER_ADVICE}/{part}'
        self.advice: FeederAdvice | None = None
        self._detections: DetectionArray | None = None
        self._news = Future()
        subscribe(node, DetectionArray, DETECTIONS, self._on_detections, CELL)
        subscribe(node, FeederAdvice, self._topic, self._on_advice, LATCHED)

    def to(
        self, stamp: Time, least: int, *, waits: bool = False
    ) -> tuple[DetectionArray, FeederAdvice] | None:
        """Return detections and advice for an image, if they have arrived.

        stamp : exposure of the image
        least : minimum epoch of the advice
        waits : whether the advice may be to wait
        """
        seen, advice = self._detections, self.advice
        if seen is None or seen.header.stamp != stamp:
            return None
        if advice is None or advice.image != seen.image or advice.epoch < least:
            return None
        return None if advice.choice == FeederAdvice.WAIT and not waits else (seen, advice)

    async def reach(self, epoch: int, seconds: float) -> None:
        """Wait until the controller has counted results up to an epoch, at most a real time."""

        def known() -> bool | None:
            return True if self.advice is not None and self.advice.epoch >= epoch else None

        await self.until(known, seconds)

    async def until(self, found: Callable[[], Found | None], seconds: float) -> Found | None:
        """Return what a function finds after a message; None after a real time."""
        end = time.monotonic() + seconds
        while (result := found()) is None:
            left = end - time.monotonic()
            if left <= 0:
                return None
            self._news = Future(executor=self._node.executor)
            await wait_for(self._node, self._news, left)
        return result

    def hint(self, now: int) -> str:
        """Return why there is no advice for the image of a time, ns."""
        seen = self._detections
        if not self._node.count_publishers(DETECTIONS):
            return f'no advice: {DETECTIONS} has no publisher, start vision_example'
        if seen is None or seen.header.stamp.sec < now // 10**9:
            return f'no advice: the newest image has no {DETECTIONS}, check the vision system'
        return (
            f'no advice for the newest image on {self._topic}: check '
            'feeder_controller, and that it runs with use_sim_time'
        )

    def _on_detections(self, message: DetectionArray) -> None:
        self._detections = message
        self._notify()

    def _on_advice(self, message: FeederAdvice) -> None:
        self.advice = message
        self._notify()

    def _notify(self) -> None:
        if not self._news.done():
            self._news.set_result(None)
