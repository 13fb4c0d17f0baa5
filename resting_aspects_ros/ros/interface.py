"""Names and QoS of the topics, services and actions of the suite."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from resting_aspects_interfaces.msg import FeederAdvice, PickResult

from resting_aspects_ros.logs.topics import Qos

DROP_SIMULATOR = 'drop_simulator'
ASPECT_CLASSIFIER = 'aspect_classifier'
DROP_RECORDER = 'drop_recorder'
LOG_REPLAYER = 'log_replayer'
FEEDER_CONTROLLER = 'feeder_controller'

DROP_PART = 'drop_part'
REORIENT_PART = 'reorient_part'
GET_DISTRIBUTION = 'get_distribution'
CLASSIFY_POSE = 'classify_pose'
GET_TRANSITIONS = 'get_transitions'
IDENTIFY_PART = 'identify_part'
FORECAST = 'forecast'
PARTS = 'parts'  # + /<part>
RESTING_POSES = 'resting_poses'
ASPECT_DISTRIBUTIONS = 'aspect_distributions'  # + /<part>
TRANSITIONS = 'transitions'  # + /<part>
SURROUNDINGS = 'surroundings'  # + /<part>
OUTLINES = 'outlines'  # + /<part>
MARKERS = 'markers'
SURROUNDINGS_MARKERS = 'surroundings_markers'
# Absolute: ROS tools expect this name.
DIAGNOSTICS = '/diagnostics'
# Hidden topic, + /<kind of node>; see health.py.
PRESENCE = '_present'
# Services of log_replayer, below its name.
PAUSE = '~/pause'
RESUME = '~/resume'
CURRENT_POSES = 'current_poses'
DEFAULT_CONDITIONS = 'default_conditions'
DETECTIONS = 'detections'
PICK_RESULT = 'pick_result'
FEEDER_ADVICE = 'feeder_advice'  # + /<part>
OBSERVED_COUNTS = 'observed_counts'  # + /<part>
POSTERIOR = 'posterior'  # + /<part>

FRAME = 'tray'


def _latched(depth: int) -> QoSProfile:
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


# Late subscribers receive the newest message.
LATCHED = _latched(1)
# Surroundings of runs: the newest ones of a part, which can differ from run to run.
SURROUNDINGS_QOS = _latched(10)
# For a subscriber that needs every message, including those that arrive while it is busy.
ALL_LATCHED = _latched(1000)
# The largest run has 200 messages with poses, and each can wait for a slow or late subscriber:
# reliable QoS alone does not throttle a publisher.
POSES = _latched(200)
# By default ROS queues 10 requests of a service: the 11th concurrent request would be lost, and
# its client would wait forever.
SERVICES = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
# The same QoS for the services of an action.
ACTION_SERVICES = {
    'goal_service_qos_profile': SERVICES,
    'result_service_qos_profile': SERVICES,
    'cancel_service_qos_profile': SERVICES,
}
# Of the cell: detections and pick_result. An older one is of no use to a late subscriber.
CELL = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
# For a subscriber of observed_counts/<part>: it receives the messages of any publisher, also the
# latched ones if the publisher offers them.
COUNTS = QoSProfile(
    depth=1000,
    reliability=ReliabilityPolicy.BEST_AVAILABLE,
    durability=DurabilityPolicy.BEST_AVAILABLE,
)


def offered_qos(profile: QoSProfile) -> Qos:
    """Return a quality of service as a log stores it."""
    return Qos(
        depth=profile.depth,
        reliability=profile.reliability.short_key,
        durability=profile.durability.short_key,
        history=profile.history.short_key,
    )


CHOICES = {
    FeederAdvice.WAIT: 'wait',
    FeederAdvice.PICK: 'pick',
    FeederAdvice.FLIP: 'flip',
    FeederAdvice.SPREAD: 'spread',
    FeederAdvice.SUPPLY: 'supply',
}
RESULTS = {
    PickResult.PICKED: 'picked',
    PickResult.MISSED: 'missed',
    PickResult.DROPPED: 'dropped',
    PickResult.MOVED: 'moved',
}
