"""Launch the nodes of the suite, one process each, and RViz on request.

`ros2 launch resting_aspects_ros resting_aspects.launch.py --show-args` lists the arguments.
"""

from pathlib import Path

from ament_index_python.packages import PackageNotFoundError
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch.substitutions.substitution_failure import SubstitutionFailure
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import ExecutableInPackage, FindPackageShare

PACKAGE = 'resting_aspects_ros'
# The parameters of each node that are launch arguments too.
NODES = {
    'drop_simulator': ('parts_folder', 'surface', 'workers'),
    'aspect_classifier': ('log_folder',),
    'drop_recorder': ('log_folder',),
    'log_replayer': ('log',),
    'feeder_controller': ('part',),
    'vision_example': ('part',),
    'camera_simulator': ('part',),
}
# The type of a parameter is declared, because launch would convert the folder name 2025 to int.
TYPES = {
    'parts_folder': str,
    'surface': str,
    'workers': int,
    'log_folder': str,
    'log': str,
    'part': str,
}
# The nodes of each value of `feeder`. With a simulated camera, the others use its time.
FEEDERS = {
    'none': (),
    'controller': ('feeder_controller',),
    'simulated': ('feeder_controller', 'vision_example', 'camera_simulator'),
}
RESPAWN_DELAY = 2.0  # s


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the function that checks them before it starts the nodes."""
    share = FindPackageShare(PACKAGE)
    parameters = PathJoinSubstitution([share, 'config', 'resting_aspects.yaml'])
    descriptions = {
        'log_folder': 'folder of the logs',
        'parts_folder': 'folder of meshes',
        'surface': 'surface of requests that do not name one',
        'workers': 'number of simulation processes',
        'part': 'part of the feeder nodes',
    }
    switches = {
        'respawn': 'start a node again that ends, instead of ending all',
        'rviz': 'start RViz',
    }
    return LaunchDescription(
        [
            DeclareLaunchArgument('namespace', default_value='', description='of all nodes'),
            DeclareLaunchArgument(
                'params_file', default_value=parameters, description='ROS parameter file'
            ),
            *[
                DeclareLaunchArgument(
                    name,
                    default_value='',
                    description=f'{words}; if empty, params_file decides',
                )
                for name, words in descriptions.items()
            ],
            DeclareLaunchArgument(
                'log',
                default_value='',
                description='log to replay, instead of dropping and recording; if empty, none',
            ),
            DeclareLaunchArgument(
                'feeder',
                default_value='none',
                choices=list(FEEDERS),
                description='start feeder_controller; simulated: with camera and vision',
            ),
            *[
                DeclareLaunchArgument(
                    name, default_value='false', choices=['true', 'false'], description=words
                )
                for name, words in switches.items()
            ],
            OpaqueFunction(function=suite),
        ]
    )


def suite(context: LaunchContext) -> list[Node]:
    """Return all nodes; raises RuntimeError before any is started if one cannot be started.

    launch leaves the processes that already run without a parent when starting another one fails.
    """
    given = context.launch_configurations
    if not Path(given['params_file']).is_file():
        raise RuntimeError(f'invalid params_file {given["params_file"]!r}: expected a file')
    source = ('log_replayer',) if given['log'] else ('drop_simulator', 'drop_recorder')
    names = ('aspect_classifier', *source, *FEEDERS[given['feeder']])
    nodes = [suite_node(context, name) for name in names]
    if given['rviz'] == 'true':
        nodes += rviz()
    for node in nodes:
        check_installed(context, node)
    return nodes


def check_installed(context: LaunchContext, node: Node) -> None:
    """Raise RuntimeError if the program of a node is not installed."""
    package, program = node.node_package, node.node_executable
    try:
        ExecutableInPackage(program, package).perform(context)
    except (PackageNotFoundError, SubstitutionFailure) as error:
        raise RuntimeError(
            f'{program} cannot be started: expected package {package} to be installed, '
            f'for example with "apt install ros-jazzy-{package.replace("_", "-")}" ({error})'
        ) from None


def suite_node(context: LaunchContext, name: str) -> Node:
    """Return a node of the suite; launch arguments that are given override params_file.

    All nodes end with it, unless it is started again.
    """
    texts = context.launch_configurations
    given = {
        argument: ParameterValue(LaunchConfiguration(argument), value_type=TYPES[argument])
        for argument in NODES[name]
        if texts[argument]
    }
    for argument, value in given.items():
        try:
            value.evaluate(context)
        except ValueError:
            text, kind = texts[argument], TYPES[argument].__name__
            raise RuntimeError(f'invalid {argument} {text!r}: expected {kind}') from None
    if texts['feeder'] == 'simulated' and name in ('feeder_controller', 'vision_example'):
        given['use_sim_time'] = True
    if texts['respawn'] == 'true':
        at_end = {'respawn': True, 'respawn_delay': RESPAWN_DELAY}
    else:
        at_end = {'on_exit': Shutdown(reason=f'{name} has ended')}
    return Node(
        package=PACKAGE,
        executable=name,
        # With its full name, the node's own values also override those of a wildcard.
        name=name,
        namespace=LaunchConfiguration('namespace'),
        parameters=[LaunchConfiguration('params_file'), *([given] if given else [])],
        output='screen',
        **at_end,
    )


def rviz() -> list[Node]:
    """Return RViz and a transform below `tray`, because RViz needs its fixed frame in TF.

    The transform that places the tray in the cell is left to the user.
    """
    view = PathJoinSubstitution([FindPackageShare(PACKAGE), 'rviz', 'resting_aspects.rviz'])
    namespace = LaunchConfiguration('namespace')
    return [
        Node(package='rviz2', executable='rviz2', namespace=namespace, arguments=['-d', view]),
        Node(
            package='tf2_ros',
            executable='static_transform_publisher',
            namespace=namespace,
            arguments=['--frame-id', 'tray', '--child-frame-id', 'tray_in_rviz'],
        ),
    ]
