"""The ament_python package for colcon and pip."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = 'resting_aspects_ros'


def shared(folder):
    """Return (target, files) of each folder below one, for share/<package>."""
    found = Path(folder).rglob('*')
    files = sorted(path for path in found if path.is_file() and path.suffix != '.pyc')
    return [
        (f'share/{NAME}/{parent}', [str(file) for file in files if file.parent == parent])
        for parent in sorted({file.parent for file in files})
    ]


setup(
    name=NAME,
    version='0.1.0',
    description='Natural resting aspects of parts, by simulated drops, as a ROS 2 node suite.',
    license='Apache-2.0',
    maintainer='resting_aspects_ros maintainers',
    maintainer_email='maintainers@resting-aspects.invalid',
    python_requires='>=3.10',
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={NAME: ['report/page_files/*', 'studio/page_files/*']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        *shared('config'),
        *shared('launch'),
        *shared('rviz'),
    ],
    # pip installs the packages of requirements.txt, and rosdep those of package.xml.
    install_requires=['setuptools'],
    extras_require={
        'dask': ['distributed'],
        'bodies': ['manifold3d'],
        'pieces': ['coacd'],
        'curved': ['fast-simplification'],
        'parquet': ['pyarrow'],
    },
    zip_safe=True,
    entry_points={
        'console_scripts': [
            f'resting_aspects = {NAME}.cli.main:main',
            f'drop_simulator = {NAME}.nodes.drop_simulator.node:main',
            f'aspect_classifier = {NAME}.nodes.aspect_classifier.node:main',
            f'drop_recorder = {NAME}.nodes.drop_recorder.node:main',
            f'feeder_controller = {NAME}.nodes.feeder_controller.node:main',
            f'log_replayer = {NAME}.nodes.log_replayer.node:main',
            f'camera_simulator = {NAME}.nodes.camera_simulator.node:main',
            f'vision_example = {NAME}.nodes.vision_example.node:main',
        ],
    },
)
