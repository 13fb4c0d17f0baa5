"""The ament_python package for colcon and pip."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = 'resting_aspects_ros'

# What the command line and the Python interface need without ROS, in the ranges that are known to
# work; requirements.txt has the versions that are tested. rosdep installs those of package.xml
# instead. The reasons in full are in docs/explanation/design.md.
DEPENDENCIES = [
    'cascadio',  # solids of STEP files
    'coacd',  # convex pieces of a part, for edges that touch its real shape
    'contourpy>=1.2',  # outlines of meshes of many triangles
    'ezdxf>=1',  # outlines as DXF
    'fast-simplification',  # fewer triangles for curved surroundings
    'jinja2>=3',  # pages
    'llvmlite',  # loads the compiled kernel; numba determines its version
    'lxml>=4.9',  # with which trimesh reads 3MF
    'manifold3d>=2.5',  # unites bodies that overlap
    'matplotlib>=3.6',  # figures
    'mcap>=1.1,<2',  # logs
    'networkx>=2.8',  # trimesh reads 3MF files with it
    'numba>=0.58',  # compiles the kernel
    'numpy>=1.26,<3',  # arrays
    'aiohttp>=3.14,<4',  # serves the page of resting_aspects studio
    'openpyxl>=3.1,<4',  # tables as XLSX
    'pillow>=10',  # templates of outlines as PNG
    'pydantic>=1.10,<3',  # checks the YAML and JSON files that are read
    'pyyaml>=6',  # files of parts and surfaces
    'rich>=13',  # tables and progress
    'scipy>=1.11,<2',  # hulls, rotations, intervals
    'shapely>=2,<3',  # polygons of outlines
    'trimesh>=4,<6',  # meshes and their volume integrals
]
EXTRAS = {
    'bullet': ['pybullet>=3.2,<4'],  # edges, meshes, and an independent check of the kernel
    'dask': ['distributed'],  # drops on many machines
    # The kernel on an NVIDIA GPU. Numba-cuda 0.30 uses a function that NumPy 2.5 has removed.
    'gpu': ['numba-cuda[cu13]>=0.30', 'numpy<2.5'],
    # The nodes also need the messages, which `make setup` builds; see docs/how_to/install.md.
    'ros': [
        'opencv-python-headless>=4.6',  # contours in the image of a camera
        'ros-jazzy-common-interfaces',
        'ros-jazzy-rclpy',
        'ros-jazzy-rmw-fastrtps-cpp',
    ],
}


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
    install_requires=DEPENDENCIES,
    extras_require=EXTRAS,
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
