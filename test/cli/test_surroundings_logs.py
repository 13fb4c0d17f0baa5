"""Logs of runs in surroundings are self-contained, and all commands read them."""

import dataclasses
import json

import numpy as np
import pytest
from mcap.reader import make_reader

import resting_aspects_ros as ra
from resting_aspects_ros.api.plan import plan_drops
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.cli.main import main
from resting_aspects_ros.errors import LogError
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
    corners = [(x, y, z) for z in (-10, 0) for y in (-200, 200) for x in (-200, 200)]
    faces = ['5 6 8', '5 8 7', '1 3 4', '1 4 2', '1 2 6', '1 6 5']
    faces += ['3 7 8', '3 8 4', '1 5 7', '1 7 3', '2 4 8', '2 8 6']
    lines = [f'v {x} {y} {z}' for x, y, z in corners] + [f'f {each}' for each in faces]
    (folder / 'block.obj').write_text('\n'.join(lines))
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


@pytest.fixture(scope='module')
def chute_log(tmp_path_factory, part, surfaces):
    found = ra.surroundings('l_chute')
    return written(tmp_path_factory.mktemp('logs'), part('l_bracket'), found, surfaces)


@pytest.fixture(scope='module')
def block_log(tmp_path_factory, part, surfaces, block):
    return written(tmp_path_factory.mktemp('logs'), part('l_bracket'), block, surfaces)


def run_main(capsys, *arguments):
    code = main([str(each) for each in arguments])
    return code, capsys.readouterr().out


def test_a_log_in_a_chute_is_read_with_its_contacts(chute_log, assert_same_poses):
    folder, poses, total = chute_log
    result = ra.read_log(folder)
    assert result.complete
    assert result.distribution.counts.tolist() == total.counts.tolist()
    assert (result.distribution.lost, result.distribution.sliding) == (1, 1)
    assert [p.count for p in result.contacts.placements] == [DROPS - 3]
    assert_same_poses(result.poses, poses)


def test_poses_in_a_chute_are_classified_by_their_side_on_the_belt(chute_log, part):
    _, poses, total = chute_log
    found = ra.classify(poses, part('l_bracket'), surroundings='l_chute')
    assert found.by_part.distribution.counts.tolist() == total.counts.tolist()
    assert total.counts.sum() == DROPS - 3
    assert found.by_part.distribution.drops == DROPS
    with pytest.warns(match='in no aspect'):
        level = ra.classify(poses, part('l_bracket'))
    assert not level.by_part.distribution.counts.any()
    with pytest.raises(ra.InvalidValueError, match='surroundings: expected only with a part'):
        ra.classify(poses, surroundings='l_chute')


def test_a_mesh_travels_in_the_log(block_log, block):
    folder, _, total = block_log
    (path,) = folder.glob('*.mcap')
    with path.open('rb') as stream:
        attachments = {each.name: each.data for each in make_reader(stream).iter_attachments()}
    assert set(attachments) == {'l_bracket.stl', 'block.obj'}
    assert b'v -200 -200 -10' in attachments['block.obj']
    result = logged_result(folder, keep_poses=True)
    assert result.distribution.counts.tolist() == total.counts.tolist()
    assert 'block' in result.subtitle
    found = result.run.conditions.surroundings
    np.testing.assert_array_equal(found.shape.vertices, block.shape.vertices)


def test_a_log_that_is_cut_off_is_recovered(chute_log, tmp_path, capsys):
    (path,) = chute_log[0].glob('*.mcap')
    cut = tmp_path / path.name
    cut.write_bytes(path.read_bytes()[:-300])
    code, text = run_main(capsys, 'recover', cut)
    assert code == 0
    assert f'{DROPS} of {DROPS} drops of l_bracket' in text
    assert logged_result(cut).distribution.drops == DROPS
    assert json.loads(run_main(capsys, 'info', cut, '--json')[1])['log']['whole']


def test_a_log_without_the_mesh_is_an_error(block_log, monkeypatch):
    monkeypatch.setattr('resting_aspects_ros.run_logs.contents.SURROUNDINGS_TYPE', 'a/msg/None')
    monkeypatch.setattr(
        'resting_aspects_ros.run_logs.contents.LoggedRun.surroundings', None, raising=True
    )
    with pytest.raises(LogError, match='lacks the mesh'):
        logged_result(block_log[0])


@pytest.mark.slow
def test_drops_in_a_log_are_repeated_without_the_file_of_the_mesh(
    tmp_path, part, block, monkeypatch
):
    made = ra.drop(
        'l_bracket', drops=4, seed=5, workers=1, surroundings=block, log=tmp_path, keep_poses=True
    )
    out = tmp_path / 'out'
    assert main(['drop', '--from-log', str(made.log), '--out', str(out), '--workers', '1']) == 0
    (again,) = out.glob('distribution.json')
    document = json.loads(again.read_text())
    assert document['drops'] == 4
    assert [a['count'] for a in document['aspects']] == made.distribution.counts.tolist()
    assert len(find_aspects(part('l_bracket'))) == len(document['aspects'])
