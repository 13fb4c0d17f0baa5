"""Names and qualities of service of the suite's topics, services and action: one place for all."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

DROP_SIMULATOR = 'drop_simulator'
ASPECT_CLASSIFIER = 'aspect_classifier'
DROP_RECORDER = 'drop_recorder'
LOG_REPLAYER = 'log_replayer'

DROP_PART = 'drop_part'
GET_DISTRIBUTION = 'get_distribution'
CLASSIFY_POSE = 'classify_pose'
LIST_PARTS = 'list_parts'
PARTS = 'parts'  # + /<part>
RESTING_POSES = 'resting_poses'
ASPECT_DISTRIBUTIONS = 'aspect_distributions'  # + /<part>
MARKERS = 'markers'
RECORDED_RUNS = 'recorded_runs'
# Not relative: where ROS looks for it.
DIAGNOSTICS = '/diagnostics'
# Hidden, + /<kind of node>, see liveliness.py.
PRESENCE = '_present'
# Of log_replayer, below its name.
PAUSE = '~/pause'
RESUME = '~/resume'
CURRENT_POSES = 'current_poses'
DEFAULT_CONDITIONS = 'default_conditions'

FRAME = 'tray'

# The newest message, also for those who come later.
LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
# For a reader that wants each of them, also those that come while it is busy.
ALL_LATCHED = QoSProfile(
    depth=1000, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
# ROS keeps 10 requests of a service: the 11th at once would be lost, and its client wait for ever.
SERVICES = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
# The same for the services that an action is made of.
ACTION_SERVICES = {
    'goal_service_qos_profile': SERVICES,
    'result_service_qos_profile': SERVICES,
    'cancel_service_qos_profile': SERVICES,
}
# All batches of the largest run, on both sides: reliable alone does not hold a publisher back, and
# a reader that is slow or late would lose batches.
POSES_DEPTH = 2000
POSES = QoSProfile(
    depth=POSES_DEPTH,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
# Poses in a batch: at least this, so that small runs are few messages, and more for large ones, so
# that no run has more than POSES_DEPTH batches.
MIN_BATCH = 250


def batch_size(drops: int) -> int:
    """Poses in each batch but the last of a run of so many drops."""
    return max(MIN_BATCH, -(-drops // POSES_DEPTH))
