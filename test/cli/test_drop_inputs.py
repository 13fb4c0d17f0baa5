"""Inputs of `drop`: named parts and mesh files of every format, with units and YAML."""

import json

import pytest

from resting_aspects_ros.part.loading import load_part


@pytest.fixture
def heights(run):
    """Drop a part once; returns the heights of the centre of mass in its aspects, m."""

    def dropped(*words):
        ended = run('drop', *words, '--drops', 1, '--json')
        assert ended.returncode == 0, ended.stderr
        return [aspect['com_height'] for aspect in json.loads(ended.stdout)['aspects']]

    return dropped


BOX = [0.005, 0.005, 0.01, 0.01, 0.015, 0.015]


@pytest.mark.parametrize(
    ('file', 'mesh_format'),
    [('binary.stl', 'stl'), ('ascii.stl', 'stl_ascii'), ('Box.OBJ', 'obj'), ('my-box.ply', 'ply')],
)
def test_a_mesh_file(heights, box, tmp_path, file, mesh_format):
    box.export(tmp_path / file, file_type=mesh_format)
    assert heights(file) == pytest.approx(BOX)


@pytest.mark.parametrize('file', ['my_box.stl', 'my_box.STL', 'my_box.obj'])
def test_missing_file_ending_is_suggested(refused, box, tmp_path, file):
    box.export(tmp_path / file, file_type=file[-3:].lower())
    assert refused('drop', 'my_box') == (
        f"error: part 'my_box' is not known; for the mesh file in this folder, write {file!r}"
    )


def test_a_mesh_file_in_a_folder_and_its_unit(heights, box, tmp_path):
    (tmp_path / 'in.here').mkdir()
    box.export(tmp_path / 'in.here' / 'box.stl')
    scaled = heights(tmp_path / 'in.here' / 'box.stl', '--unit', 'in')
    assert scaled == pytest.approx([25.4 * height for height in BOX])


@pytest.mark.parametrize(('unit', 'metres'), [('mm', 1e-3), ('in', 0.0254)])
def test_yaml_beside_a_mesh_file_is_used(run, box, tmp_path, unit, metres):
    box.export(tmp_path / 'box.stl')
    (tmp_path / 'box.yaml').write_text(
        f'unit: {unit}\ndensity: 2700\ncentre_of_mass: [0, 0, 5]\n', encoding='utf-8'
    )
    ended = run('drop', 'box.stl', '--unit', unit, '--drops', 1, '--json')
    document = json.loads(ended.stdout)
    of_z = {
        round(aspect['down_in_part'][2]): aspect['com_height'] for aspect in document['aspects']
    }
    assert of_z[-1] == pytest.approx(20 * metres)
    assert of_z[1] == pytest.approx(10 * metres)
    meant = load_part(
        tmp_path / 'box.stl', unit=unit, density=2700, centre_of_mass=[0, 0, 5 * metres]
    )
    assert document['part_sha256'] == meant.part_sha256


def test_unit_that_contradicts_the_yaml_is_refused(refused, box, tmp_path):
    box.export(tmp_path / 'box.stl')
    (tmp_path / 'box.yaml').write_text('unit: cm\n', encoding='utf-8')
    line = refused('drop', 'box.stl', '--unit', 'in')
    assert line == "error: invalid unit 'in': expected 'cm', the unit in 'box.yaml'"


def test_parts_of_another_folder(heights, refused, box, tmp_path):
    (tmp_path / 'mine').mkdir()
    box.export(tmp_path / 'mine' / 'brick.stl')
    (tmp_path / 'mine' / 'brick.yaml').write_text('unit: cm\n', encoding='utf-8')
    assert heights('brick', '--parts', 'mine') == pytest.approx([10 * h for h in BOX])
    line = refused('drop', 'l_bracket', '--parts', 'mine')
    assert line == "error: part 'l_bracket' is not known; known parts: brick"


def test_warnings_do_not_go_to_stdout(run, box, tmp_path):
    box.invert()
    box.export(tmp_path / 'box.stl')
    ended = run('drop', 'box.stl', '--drops', 1, '--json')
    warnings = [line for line in ended.stderr.splitlines() if line.startswith('warning: ')]
    assert len(warnings) == 1
    assert "'box.stl'" in warnings[0]
    assert json.loads(ended.stdout)['part'] == 'box'


ROUND = """solid a
facet normal 0 0 0
outer loop
vertex 0 0 0
vertex nan 0 0
vertex 0 1 0
endloop
endfacet
endsolid a
"""


@pytest.mark.parametrize(
    ('name', 'content', 'words'),
    [
        ('missing.stl', None, "'missing.stl' does not exist"),
        ('broken.stl', 'hello', "'broken.stl' is not an STL"),
        ('empty.ply', '', "'empty.ply' is empty"),
        ('nan.stl', ROUND, 'finite'),
        (
            'model.sldprt',
            'x',
            '.ply, .off, .glb, .3mf, .step, .stp. It is a CAD file: export an STL',
        ),
        ('.', None, 'is a folder'),
        ('..', None, 'is a folder'),
        ('/', None, 'is a folder'),
    ],
)
def test_invalid_mesh_is_refused_with_one_line(refused, tmp_path, name, content, words):
    if content is not None:
        (tmp_path / name).write_text(content, encoding='utf-8')
    line = refused('drop', name)
    assert words in line
    assert repr(name) in line


def test_height_in_the_wrong_unit_is_refused_unless_forced(refused, run, box, tmp_path):
    line = refused('drop', 'l_bracket', '--height', '60')
    assert line.startswith('error: invalid height 60 m: expected at most 500 times the radius')
    assert '--force' in line
    assert line.endswith('unless they have a unit, such as 60mm')
    # The limit depends on the size of the part.
    box.export(tmp_path / 'box.stl')
    words = ('drop', 'box.stl', '--drops', 1)
    assert run(*words, '--unit', 'mm', '--height', '8').returncode == 0
    assert run(*words, '--unit', 'um', '--height', '8mm').returncode == 0
    assert refused(*words, '--unit', 'mm', '--height', '11').startswith('error: invalid height')
    ended = run(*words, '--unit', 'um', '--height', '11mm')
    assert ended.returncode == 2
    assert ended.stderr.splitlines()[-1].startswith('error: invalid height')
    assert run(*words, '--unit', 'um', '--height', '11mm', '--force').returncode == 0


@pytest.mark.parametrize('text', ['1e1', '10', '1.0e1', '1_0', '10.0'])
def test_number_of_drops_in_any_notation(run, text):
    ended = run('drop', 'tetrahedron', '--drops', text, '--json')
    assert json.loads(ended.stdout)['drops'] == 10, ended.stderr


@pytest.mark.parametrize('text', ['1.5', '1e-1', 'many', 'inf', '1e999999999', '1e-999999999', ''])
def test_number_that_is_not_an_integer_is_refused(refused, text):
    assert 'is not an integer, such as 1000 or 1e4' in refused(
        'drop', 'tetrahedron', '--drops', text
    )


@pytest.mark.parametrize('text', ['25%', '0.25', '25 %', '.25'])
def test_precision_as_a_share_or_in_percent(run, text):
    ended = run('drop', 'tetrahedron', '--precision', text, '--drops', 10, '--json')
    assert json.loads(ended.stdout)['precision'] == 0.25, ended.stderr
