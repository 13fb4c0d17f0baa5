"""Logs of runs in surroundings are self-contained, and all commands read them."""

import dataclasses
import json

import numpy as np
import pytest
import trimesh
from mcap.reader import make_reader

import resting_aspects_ros as ra
from resting_aspects_ros.api.plan import plan_drops
from resting_aspects_ros.run_logs.contents import logged_result
from resting_aspects_ros.run_logs.recorder import LocalRunLog
from resting_aspects_ros.simulation.scene import in_tray_axes
from resting_aspects_ros.statistics.distribution import count_poses, no_drops
from resting_aspects_ros.statistics.poses import RestingPoses

DROPS = 12


@pytest.fixture(scope='module')
def block(tmp_path_factory):
    """Surroundings of a mesh: the upper face of a block of 400 x 400 x 10 mm, at z = 0."""
    folder = tmp_path_factory.mktemp('surroundings')
    block = trimesh.creation.box((400, 400, 10))
    block.apply_translation((0, 0, -5))
    block.export(folder / 'block.obj')
    (folder / 'block.yaml').write_text('kind: mesh\nmesh: block.obj\nunit: mm\n')
    return ra.surroundings(folder / 'block.yaml')


def written(folder, part, found, surfaces):
    """Write a run of made-up poses in surroundings; return its log, its poses and the counts."""
    conditions = dataclasses.replace(surfaces.get(), surroundings=found)
    planned = plan_drops(part, conditions, drops=DROPS, seed=3)
    lies = np.tile(planned.empty.aspects[0].orientation, (DROPS, 1))
    orientation = in_tray_axes(planned.job.scene, lies)
    position = np.tile([0.0, 0.0, 0.5], (DROPS, 1))
    poses = RestingPoses(
        0,
        position,
        orientation,
        np.array([0] * (DROPS - 3) + [1, 3, 4], dtype=np.uint8),
        np.zeros(DROPS, dtype=np.uint8),
        np.full(DROPS, 0.5),
        np.zeros(DROPS),
    )
    total = no_drops(planned.empty.aspects) + count_poses(planned.empty.aspects, poses)
    log = LocalRunLog(folder, part, planned.run)
    log.add(poses, None)
    if planned.contacts is not None:
        planned.contacts.add(poses, None)
    log.close(total, planned.contacts)
    return log.folder, poses, total


def test_a_log_in_a_chute_is_read_and_its_poses_are_classified(
    run, tmp_path, part, surfaces, assert_same_poses
):
    """The poses are classified by their side on the belt."""
    found = ra.surroundings('l_chute')
    folder, poses, total = written(tmp_path, part('l_bracket'), found, surfaces)
    result = ra.read_log(folder)
    assert result.complete
    assert result.distribution.counts.tolist() == total.counts.tolist()
    assert (result.distribution.lost, result.distribution.sliding) == (1, 1)
    assert [p.count for p in result.contacts.placements] == [DROPS - 3]
    document = json.loads(run('info', folder, '--json').stdout)
    assert [row['count'] for row in document['contacts']] == [DROPS - 3]
    assert_same_poses(result.poses, poses)
    found = ra.classify(poses, part('l_bracket'), surroundings='l_chute').by_part.distribution
    assert found.counts.tolist() == total.counts.tolist()
    assert (found.counts.sum(), found.drops) == (DROPS - 3, DROPS)
    with pytest.warns(match='in no aspect'):
        level = ra.classify(poses, part('l_bracket'))
    assert not level.by_part.distribution.counts.any()
    with pytest.raises(ra.InvalidValueError, match='surroundings: expected only with a part'):
        ra.classify(poses, surroundings='l_chute')


def test_a_mesh_travels_in_the_log(tmp_path, part, surfaces, block):
    folder, _, total = written(tmp_path, part('l_bracket'), block, surfaces)
    (path,) = folder.glob('*.mcap')
    with path.open('rb') as stream:
        attachments = {each.name: each.data for each in make_reader(stream).iter_attachments()}
    assert set(attachments) == {'l_bracket.stl', 'block.obj'}
    result = logged_result(folder, keep_poses=True)
    assert result.distribution.counts.tolist() == total.counts.tolist()
    assert 'block' in result.subtitle
    found = result.run.conditions.surroundings
    np.testing.assert_array_equal(found.shape.vertices, block.shape.vertices)


@pytest.mark.slow
def test_drops_in_a_log_are_repeated_without_the_file_of_the_mesh(run, tmp_path, block):
    made = ra.drop('l_bracket', drops=4, seed=5, workers=1, surroundings=block, log=tmp_path)
    ended = run('drop', '--from-log', made.log, '--workers', 1, '--json')
    assert ended.returncode == 0, ended.stderr
    document = json.loads(ended.stdout)
    assert document['drops'] == 4
    assert [a['count'] for a in document['aspects']] == made.distribution.counts.tolist()
