"""Logs of runs in surroundings are self-contained, and all commands read them."""

import json

import numpy as np
import pytest
import trimesh
from mcap.reader import make_reader

import resting_aspects_ros as ra
from resting_aspects_ros.run_logs import logged_result


def test_a_log_in_a_chute_is_read(run, tmp_path):
    made = ra.drop('l_bracket', 12, seed=3, surroundings='l_chute', log=tmp_path)
    contacts = sorted(placement.count for placement in made.contacts.placements)
    assert sum(contacts) > 6
    document = json.loads(run('info', made.log, '--json').stdout)
    assert sorted(row['count'] for row in document['contacts']) == contacts


@pytest.mark.slow
def test_a_mesh_travels_in_the_log_and_its_drops_are_repeated(run, tmp_path):
    # The upper face of a block of 400 x 400 x 10 mm is at z = 0.
    mesh = trimesh.creation.box((400, 400, 10))
    mesh.apply_translation((0, 0, -5))
    mesh.export(tmp_path / 'block.obj')
    (tmp_path / 'block.yaml').write_text('kind: mesh\nmesh: block.obj\nunit: mm\n')
    block = ra.surroundings(tmp_path / 'block.yaml')
    made = ra.drop('l_bracket', 4, seed=5, workers=1, surroundings=block, log=tmp_path)
    (tmp_path / 'block.obj').unlink()
    (file,) = made.log.glob('*.mcap')
    with file.open('rb') as stream:
        names = {each.name for each in make_reader(stream).iter_attachments()}
    assert names == {'l_bracket.stl', 'block.obj'}
    found = logged_result(made.log).run.conditions.surroundings
    np.testing.assert_array_equal(found.shape.vertices, block.shape.vertices)
    ended = run('drop', '--from-log', made.log, '--workers', 1, '--json')
    assert ended.returncode == 0, ended.stderr
    counts = [aspect['count'] for aspect in json.loads(ended.stdout)['aspects']]
    assert counts == made.distribution.counts.tolist()
