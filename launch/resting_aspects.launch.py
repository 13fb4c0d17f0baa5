"""The suite, each node a process, and RViz if it is asked for.

`ros2 launch resting_aspects_ros resting_aspects.launch.py --show-args` lists the arguments.
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

PACKAGE = 'resting_aspects_ros'


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch` asks for."""
    parameters = PathJoinSubstitution(
        [FindPackageShare(PACKAGE), 'config', 'resting_aspects.yaml']
    )
    view = PathJoinSubstitution([FindPackageShare(PACKAGE), 'rviz', 'resting_aspects.rviz'])
    as_in_file = 'empty: as params_file says'
    return LaunchDescription(
        [
            DeclareLaunchArgument('namespace', default_value='', description='of all nodes'),
            DeclareLaunchArgument(
                'params_file', default_value=parameters, description='ROS parameter file'
            ),
            DeclareLaunchArgument(
                'log_folder', default_value='', description=f'folder of the logs; {as_in_file}'
            ),
            DeclareLaunchArgument(
                'parts_folder', default_value='', description=f'folder of meshes; {as_in_file}'
            ),
            DeclareLaunchArgument(
                'surface',
                default_value='',
                description=f'surface of requests that name none; {as_in_file}',
            ),
            DeclareLaunchArgument(
                'workers', default_value='', description=f'processes that drop; {as_in_file}'
            ),
            DeclareLaunchArgument(
                'rviz', default_value='false', choices=['true', 'false'], description='show it'
            ),
            OpaqueFunction(function=suite),
            Node(
                package='rviz2',
                executable='rviz2',
                namespace=LaunchConfiguration('namespace'),
                arguments=['-d', view],
                condition=IfCondition(LaunchConfiguration('rviz')),
            ),
            # Below `tray`, so that it is in no one's way who says where the tray stands: RViz has
            # no fixed frame of which TF knows nothing.
            Node(
                package='tf2_ros',
                executable='static_transform_publisher',
                namespace=LaunchConfiguration('namespace'),
                arguments=['--frame-id', 'tray', '--child-frame-id', 'tray_in_rviz'],
                condition=IfCondition(LaunchConfiguration('rviz')),
            ),
        ]
    )


def suite(context: LaunchContext) -> list[Node]:
    """The nodes, with the launch arguments that are their parameters."""
    return [
        node(context, 'drop_simulator', 'parts_folder', 'surface', 'workers'),
        node(context, 'aspect_classifier', 'surface', 'log_folder'),
        node(context, 'drop_recorder', 'log_folder'),
    ]


def node(context: LaunchContext, executable: str, *arguments: str) -> Node:
    """A node; of the arguments those that are given go before the parameter file."""
    values = {name: LaunchConfiguration(name).perform(context) for name in arguments}
    # Typed: launch would make a number of a folder that is called 2025.
    given = {
        name: ParameterValue(value, value_type=int if name == 'workers' else str)
        for name, value in values.items()
        if value
    }
    return Node(
        package=PACKAGE,
        executable=executable,
        namespace=LaunchConfiguration('namespace'),
        parameters=[LaunchConfiguration('params_file'), *([given] if given else [])],
        output='screen',
    )
