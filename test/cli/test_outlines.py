"""`resting_aspects outlines`: its table, its document and its files."""

import json
import re

import pytest
import trimesh
from shapely import Polygon

KEYS = [
    'aspects', 'symmetry_class', 'outer', 'holes', 'area', 'length', 'width', 'height',
    'com_height', 'centroid', 'long_axis', 'orientation', 'yaw_symmetry', 'mirrored',
    'mirror_symmetric', 'family', 'look_alike',
]  # fmt: skip


@pytest.fixture
def done(run):
    """Run the command; returns what it printed."""

    def text(*words):
        ended = run('outlines', *words)
        assert ended.returncode == 0, ended.stderr
        return ended.stdout

    return text


def test_document_has_all_keys(done):
    document = json.loads(done('hex_nut', '--json'))
    assert list(document) == ['schema_version', 'part', 'mesh_sha256', 'part_sha256', 'outlines']
    assert [list(each) for each in document['outlines']] == [KEYS] * len(document['outlines'])
    (other,) = document['outlines'][0]['look_alike']
    assert list(other) == ['symmetry_class', 'overlap', 'verdict', 'resolution']


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize('name', ['hex_nut', 'cylinder_d20_h20', 'l_bracket', 'u_bracket'])
def test_output_fits_80_columns(done, name):
    text = done(name)
    assert max(map(len, text.splitlines())) <= 80
    assert '…' not in text
    assert text.startswith(f'{name}, ')


def test_sizes_of_a_box_are_shown_in_mm(done):
    text = done('box_10x20x30')
    assert re.search(r'^ *1 +1 and 2 +30\.00 x 20\.00 x 10\.00 +600 +180 deg +-', text, re.M)
    assert 'can distinguish all classes' in text


def test_same_outline_needs_grey_values(done, tmp_path):
    place = trimesh.transformations.translation_matrix((0, 0, 3))
    hole = trimesh.creation.cylinder(4, 6, transform=place)
    cup = trimesh.creation.box((20, 20, 10)).difference(hole)
    cup.export(tmp_path / 'cup.stl')
    text = ' '.join(done(tmp_path / 'cup.stl').split())
    assert 'have the same outline. No resolution distinguishes them; grey values' in text


def test_mirrored_outlines_are_reported(done, tmp_path):
    shape = Polygon([(0, 0), (40, 0), (40, 10), (10, 10), (10, 25), (0, 25)])
    trimesh.creation.extrude_polygon(shape, 6).export(tmp_path / 'l.stl')
    text = ' '.join(done(tmp_path / 'l.stl').split())
    assert re.search(r'Classes \d+ and \d+ show mirror images of each other', text)


def test_files_are_listed(done, tmp_path):
    text = ' '.join(done('washer', '--out', 'o', '--px-per-mm', '4').split())
    names = {path.name for path in (tmp_path / 'o').iterdir()}
    written = text.partition(f'Written: {len(names)} files in o: ')[2]
    named = set(re.findall(r'\w+\.\w+', written))
    assert named == {name for name in names if '_2' not in name}
    document = json.loads((tmp_path / 'o' / 'coco.json').read_text())
    assert {each['px_per_mm'] for each in document['images']} == {4}


def test_counting_sheet_has_all_classes(done, tmp_path):
    assert 'Counting sheet: s.svg' in done('u_bracket', '--counting-sheet', 's.svg')
    text = (tmp_path / 's.svg').read_text()
    for words in (
        *('u_bracket, 30 x 25 x 20 mm', 'page 1 of 1', 'date', 'surface', 'counted by'),
        *('Class 2: aspects 2 and 3', 'From above it looks like class 4 (same).', 'Unclassified'),
    ):
        assert f'>{words}<' in text
    assert text.count('>total<') == 5


@pytest.mark.slow
def test_sheet_can_be_in_the_new_folder(done, tmp_path):
    done('washer', '--out', 'o', '--counting-sheet', 'o/s.pdf', '--json')
    assert (tmp_path / 'o' / 's.pdf').is_file()


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (['gizmo'], "part 'gizmo' is not known"),
        (['washer', '--px-per-mm', '5'], "invalid --px-per-mm '5': expected only with --out"),
        (['washer', '--px-per-mm', '5px', '--out', 'o'], "invalid --px-per-mm '5px': expected a"),
        (['washer', '--px-per-mm', '0', '--out', 'o'], 'invalid px_per_mm 0.0: expected '),
        (['washer', '--px-per-mm', '1e6', '--out', 'o'], 'invalid px_per_mm 1000000.0: expected '),
        (['washer', '--counting-sheet', 's.doc'], "invalid --counting-sheet 's.doc': expected a"),
        (['washer', '--counting-sheet', 'no/s.pdf'], "the folder 'no' does not exist"),
    ],
)
def test_wrong_input_is_refused(refused, words, message):
    assert message in refused('outlines', *words)
