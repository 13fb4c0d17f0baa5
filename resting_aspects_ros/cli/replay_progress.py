"""The position of a replay, on standard error."""

from typing import TYPE_CHECKING

from resting_aspects_ros.api.progress import ShownProgress

if TYPE_CHECKING:
    from resting_aspects_ros.nodes.log_replayer.player import ReplayPosition


class ReplayProgress(ShownProgress):
    """Shows the position of a replay, on a terminal only."""

    def __init__(self) -> None:
        super().__init__('', 1.0)

    def update(self, position: 'ReplayPosition') -> None:
        """Update the position; the bar is shown from the first time on, up to the end."""
        if self._bar is None:
            return
        self._bar.update(
            self._task,
            description='paused' if position.paused else 'replay',
            completed=1.0 if position.over else position.seconds / (position.length or 1.0),
            text=str(position),
        )
        self._bar.start()
        if position.over:
            self._bar.stop()
            self._bar = None
