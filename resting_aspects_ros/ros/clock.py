"""The topic of simulated time, which only one node may publish."""

from rclpy.node import Node

# Absolute: nodes with use_sim_time subscribe to this name. Remap it for two clocks in one domain.
CLOCK = '/clock'


def clock_conflicts(node: Node) -> list[str]:
    """Return a warning if another node publishes simulated time too; call this often.

    The warning is logged once.
    """
    topic = node.resolve_topic_name(CLOCK)
    count = node.count_publishers(topic)
    if count < 2:
        return []
    problem = f'{count} nodes publish {topic}: stop one, or remap it with -r {CLOCK}:=<other name>'
    node.get_logger().warning(problem, once=True)
    return [problem]
