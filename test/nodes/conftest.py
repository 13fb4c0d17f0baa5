"""Fixtures of the nodes: `suite`, `start` and `connect` make nodes and clients in this process.

`start_process` and `processes` start real processes, for what only these show.
"""

import functools
from contextlib import closing

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from ros_graph import Graphs, Suite, new_namespace
from ros_processes import processes, run_command, start_process  # noqa: F401  # fixtures

from resting_aspects_ros.api import model_range
from resting_aspects_ros.api.plan import named_action
from resting_aspects_ros.api.reorient import ReorientResult
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.client import RestingAspectsClient
from resting_aspects_ros.errors import RestingAspectsError
from resting_aspects_ros.logs.bag import OUTCOME
from resting_aspects_ros.logs.topics import DISTRIBUTION_TYPE, PART_TYPE, POSES_TYPE, Qos, Topic
from resting_aspects_ros.logs.writer import RunLog
from resting_aspects_ros.nodes.aspect_classifier import known
from resting_aspects_ros.ros import health
from resting_aspects_ros.ros.conversions import part_msg, poses_msgs, time_msg
from resting_aspects_ros.ros.file_worker import FileLimitError, FileWorker
from resting_aspects_ros.simulation.job import plan_run
from resting_aspects_ros.simulation.workers import drop_range
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.transitions import TransitionMatrix
from resting_aspects_ros.system import parts_folder

# Number of drops in each message of the fixture ``batches``.
BATCH = 250
# The parts of the shared suite: their aspects and outlines take a second.
PARTS = ('box_10x20x30', 'l_bracket', 'tetrahedron', 'u_bracket')


# What makes the results of functions differ, whose results all nodes can share.
SHARED = {
    'read_part': lambda data, name: (hash(data), name),
    'checked_outlines': lambda part, aspects: part.part_sha256,
    'compare_outlines': lambda one, others: (id(one), *map(id, others)),
}
_shared = {}


def _call_here(self, function, arguments):
    """Run a function of a FileWorker in its thread, without the process: test/ros tests that."""
    if self._stopped:
        raise FileLimitError('the node ends')
    try:
        name = getattr(function, '__name__', '')  # a functools.partial has none
        if name not in SHARED:
            return function(*arguments)
        key = name, SHARED[name](*arguments)
        if key not in _shared:
            _shared[key] = function(*arguments)
        return _shared[key]
    except RestingAspectsError:
        raise
    except Exception as error:
        raise FileLimitError(f'unexpected error {error!r:.300}') from error


@pytest.fixture(scope='module', autouse=True)
def cheap_nodes():
    """Compute in threads of this process, model ranges from few drops, and wait for less long."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(FileWorker, '_call', _call_here)
        patch.setattr(model_range, 'DROPS', 20)
        patch.setattr(known, 'QUIET_PERIOD', 2.0)
        patch.setattr(health, 'DIAGNOSTICS_PERIOD', 0.2)
        yield


# -- nodes ----------------------------------------------------------------------------------------


@pytest.fixture(scope='session')
def graphs(wait):
    return Graphs(wait)


@pytest.fixture(scope='module')
def local(graphs):
    with graphs.use() as functions:
        yield functions


@pytest.fixture(scope='module')
def start(local):
    """Return a function that starts a node in this process until the end of the module."""
    return local[0]


@pytest.fixture(scope='module')
def connect(local):
    """Return a function that creates a client in a namespace, in this process."""
    return local[1]


@pytest.fixture
def namespace():
    return new_namespace()


@pytest.fixture(scope='session')
def few_parts(tmp_path_factory):
    """Return a function that copies example parts to a new folder."""

    def few_parts(*names):
        folder = tmp_path_factory.mktemp('parts')
        for name in names:
            for file in parts_folder().glob(f'{name}.*'):
                (folder / file.name).write_bytes(file.read_bytes())
        return folder

    return few_parts


@pytest.fixture(scope='session')
def shared_nodes(graphs, tmp_path_factory, few_parts):
    """Start the nodes of the test worker for all modules that do not end them."""
    with graphs.use() as (start, _):
        logs = tmp_path_factory.mktemp('logs')
        yield Suite(new_namespace(), logs, start, parts_folder=few_parts(*PARTS))


@pytest.fixture(scope='module')
def suite(shared_nodes, connect):
    """Return the nodes that all modules share, with a client of the module."""
    return shared_nodes.seen_by(connect(shared_nodes.namespace))


@pytest.fixture(scope='module')
def fresh_suite(start, connect, tmp_path_factory, few_parts):
    """Return a function that starts new nodes in this process, with few parts."""

    def fresh_suite(constants=(), arguments=(), **simulator):
        simulator = {'parts_folder': few_parts('box_10x20x30', 'tetrahedron'), **simulator}
        logs = tmp_path_factory.mktemp('logs')
        suite = Suite(new_namespace(), logs, start, constants, arguments, **simulator)
        return suite.seen_by(connect(suite.namespace))

    return fresh_suite


@pytest.fixture
def spinning(graphs, suite):
    """Spin the suite in a thread, for clients that block."""
    with graphs[suite.namespace].spinning():
        yield


@pytest.fixture
def client(suite, spinning):
    """A Python client of the suite, with a private node."""
    with RestingAspectsClient(ros_args=['-r', f'__ns:={suite.namespace}']) as client:
        yield client


# -- what tests see and send ----------------------------------------------------------------------


@pytest.fixture(scope='session')
def engine(part, surfaces):
    """Return the poses of the first drops of the tetrahedron, made without nodes."""

    @functools.cache
    def engine(drops, seed):
        given = {'seed': seed, 'drops': drops, 'run_id': '', 'started': 0}
        return drop_range(plan_run(part('tetrahedron'), surfaces.get(), **given)[0], 0, drops)

    return engine


@pytest.fixture(scope='session')
def invented(part, surfaces):
    """Return a function that makes a result from counts of drops and of actions (k, k)."""

    def invented(name, drops, moved, action='flip', run_id='a', unsettled=0):
        solid = part(name)
        aspects = find_aspects(solid)
        drop = Distribution(aspects, np.array(drops), 0, unsettled, 0)
        given = {'seed': 1, 'drops': drop.drops, 'run_id': run_id, 'started': 10**9}
        run = plan_run(solid, surfaces.get(), **given)[1]
        matrix = TransitionMatrix(aspects, np.hstack([moved, np.zeros((len(aspects), 4), int)]))
        return ReorientResult(matrix, named_action(action), run, solid, drop, complete=True)

    return invented


@pytest.fixture(scope='session')
def batches(part, surfaces, engine):
    """Create serialized batches of a run of the tetrahedron; each repeats the first drops."""

    def batches(count, run_id='recorded'):
        given = {'seed': 1, 'drops': count * BATCH, 'run_id': run_id, 'started': 10**18}
        run = plan_run(part('tetrahedron'), surfaces.get(), **given)[1]
        (batch,) = poses_msgs(engine(BATCH, 1), run, time_msg(7), last=False)
        for k in range(count):
            batch.first_drop = k * BATCH
            batch.last = k == count - 1
            data = serialize_message(batch)
            yield data + bytes(-len(data) % 4)  # padded as on the wire and in a log

    return batches


@pytest.fixture(scope='session')
def write_log(part):
    """Write a log of the tetrahedron with batches at even intervals; return its folder.

    gap : time between two batches, and between the part and the first batch, s
    """

    def write_log(folder, batches, gap):
        latched, deep = (Qos(depth, durability='transient_local') for depth in (1, 2000))
        described = Topic('/cell/parts/tetrahedron', PART_TYPE, latched)
        poses = Topic('/cell/resting_poses', POSES_TYPE, deep)
        with closing(RunLog(folder, 'log')) as log:
            log.write(described, serialize_message(part_msg(part('tetrahedron'))), 10**18)
            for k, batch in enumerate(batches):
                log.write(poses, batch, 10**18 + round((k + 1) * gap * 10**9))
                log.flush()
        return log.path.parent

    return write_log


@pytest.fixture(scope='session')
def write_run(part):
    """Write the log of a run with its part, batches and distribution; return its folder."""

    def write_run(folder, run, outcome, batches=(), distribution=None, described=''):
        with closing(RunLog(folder, f'{run.part}_20200101T000000Z_{run.run_id}')) as log:

            def write(name, kind, message):
                log.write(Topic(f'/{name}', kind, Qos(1)), serialize_message(message), 1)

            write(f'parts/{run.part}', PART_TYPE, part_msg(part(described or run.part)))
            for batch in batches:
                write('resting_poses', POSES_TYPE, batch)
            if distribution is not None:
                write(f'aspect_distributions/{run.part}', DISTRIBUTION_TYPE, distribution)
            log.add_metadata(OUTCOME, outcome.record())
        return log.path.parent

    return write_run


@pytest.fixture
def replay(start, namespace):
    """Start a replayer in the namespace of the test."""

    def replay(log, arguments=(), **parameters):
        given = {name: str(value).lower() for name, value in parameters.items()}
        return start('log_replayer', namespace, {**given, 'log': log}, arguments=arguments)

    return replay
