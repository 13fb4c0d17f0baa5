"""The parameters of camera_simulator: some of feeder_controller, and those of the camera."""

from resting_aspects_ros.nodes.camera_simulator.truth import CELL_PARAMETERS
from resting_aspects_ros.ros.parameters import FRAME_ID, Parameter

PARAMETERS = (
    *CELL_PARAMETERS,
    Parameter('px_per_mm', 5.0, 'pixels per millimetre of the tray', (0.1, 100.0)),
    Parameter('noise', 4.0, 'standard deviation of the noise of a pixel, grey values', (0, 100)),
    Parameter('blur', 0.7, 'standard deviation of the blur, pixels', (0, 50)),
    Parameter('speed', 0.0, 'simulated time per real time; 0: as fast as possible', (0, 1000)),
    Parameter(
        'evidence', False, 'whether to begin only when complete runs of drops and flips are known'
    ),
    Parameter(
        'subscribers',
        0,
        'number of subscribers of pick_result for which it waits before it begins',
        (0, 100),
    ),
    Parameter('seed', 1, 'the same seed and advice give the same images', (0, 1_000_000)),
    FRAME_ID,
    Parameter(
        'camera_frame',
        'camera_optical_frame',
        'frame of the images: x to the right, y down in the image, z forward',
        allowed=FRAME_ID.allowed,
    ),
)
