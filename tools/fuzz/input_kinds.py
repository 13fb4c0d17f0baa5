"""Valid input files of every kind, and what loads them; see inputs.py."""

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
import yaml

import resting_aspects_ros as ra
from fuzz.step_text import step_text
from resting_aspects_ros.api.classify import read_pose_csv
from resting_aspects_ros.api.conditions import shipped_surfaces
from resting_aspects_ros.api.count_files import read_counts, read_observed
from resting_aspects_ros.api.identify import read_polygon
from resting_aspects_ros.api.plan import read_state_csv
from resting_aspects_ros.api.result_json import document_result
from resting_aspects_ros.feeding.grasps import check_grasps
from resting_aspects_ros.simulation.actions import Actions
from resting_aspects_ros.simulation.conditions import Surfaces
from resting_aspects_ros.simulation.surroundings import named_surroundings
from resting_aspects_ros.studies.calibration.counts_file import read_surface_counts
from resting_aspects_ros.studies.points import PointStore
from resting_aspects_ros.studies.study import read_spec

CONFIG = Path(__file__).resolve().parents[2] / 'config'


@dataclass(frozen=True)
class Kind:
    """A kind of input file.

    file : str
        Name of the file that is loaded.
    seeds : tuple of bytes
        Contents of valid files.
    """

    file: str
    load: Callable[[Path], object]
    seeds: tuple[bytes, ...]


def made_kinds(folder: Path) -> dict[str, Kind]:
    """Write what the files refer to into a folder; return the kinds by name."""
    for name in ('parts/l_bracket.stl', 'surroundings/pocket.stl'):
        shutil.copy(CONFIG / name, folder)
    part = ra.load_part('tetrahedron')
    return {**yaml_kinds(), **result_kinds(part, folder), **csv_kinds(), **mesh_kinds()}


def yaml_kinds() -> dict[str, Kind]:
    """Return the kinds of YAML files."""
    known = ra.known_part('l_bracket', [1] * 5)
    uncertain = yaml.safe_load((CONFIG / 'surfaces.yaml').read_bytes())['rubber_mat']
    uncertain['uncertainty'] = {'friction': [0.1 + k / 100 for k in range(8)]}
    study = {
        'parts': ['tetrahedron', 'l_bracket.stl'],
        'surface': 'steel',
        'conditions': {'height': '60mm', 'height_of': 'LOWEST_POINT', 'spin': 3.5},
        'surroundings': {'kind': 'slope', 'angle': 0.1, 'bodies': {'floor': {'friction': 0.2}}},
        'vary': {
            'friction': {'low': 0.1, 'high': 0.5, 'levels': 3},
            'restitution': '0.2:0.8:log',
            'surroundings.angle': '1deg:5deg:4',
        },
        'design': 'curves',
        'points': 8,
        'drops': 20,
        'seed': 3,
        'tolerance': 0.05,
        'confidence': 0.95,
        'versions': {'numpy': '2.0'},
        'part_sha256': ['a', 'b'],
    }
    acted = {
        'parts': 'tetrahedron',
        'vary': {'action.speed': '0.1:0.5'},
        'design': 'factorial',
        'action': {'kind': 'kick', 'name': 'tap', 'speed': 0.3, 'time': 0.5},
    }
    counts = [
        {'surface': 'oak', 'conditions': {'height': '60 mm'}, 'parts': [
            {'name': 'block', 'box': [20, 20, 15], 'unit': 'mm', 'counts': {'z': 61, 'rest': 39}},
            {'part': 'l_bracket', 'counts': {1: 50}, 'drops': 60, 'conditions': {'spin': 1}},
        ]},
        {'way': 'thrown', 'source': 'made up', 'parts': [
            {'cylinder': [20, 10], 'counts': {'end': 3, 'side': 9}},
            {'mesh': 'l_bracket.stl', 'counts': {1: 58, '2+3': 98, 'aspect_4': 30, 5: 14}},
            {'hull': [[0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9]], 'counts': {1: 5, 'rest': 6}},
        ]},
    ]  # fmt: skip
    described = [
        'unit: mm\ndensity: 7850\nbody: 1\n',
        'mass: 1e-2\ncentre_of_mass: [10, 8, 5]\ninertia: [1e-6, 0, 0, 1e-6, 0, 1e-6]\n',
    ]
    folder = CONFIG / 'surroundings'
    return {
        'part': Kind(
            'l_bracket.yaml',
            lambda path: ra.load_part(path.with_suffix('.stl')),
            tuple(text.encode() for text in described),
        ),
        'surfaces': Kind(
            'surfaces.yaml',
            Surfaces.read,
            ((CONFIG / 'surfaces.yaml').read_bytes(), _yaml({'rubber_mat': uncertain})),
        ),
        'actions': Kind('actions.yaml', Actions, ((CONFIG / 'actions.yaml').read_bytes(),)),
        'surroundings': Kind(
            'place.yaml',
            lambda path: named_surroundings(path).scene(shipped_surfaces().get(), 0.01),
            tuple(path.read_bytes() for path in sorted(folder.glob('*.yaml'))),
        ),
        'study': Kind(
            'study.yaml', lambda path: read_spec(path).made_design(), (_yaml(study), _yaml(acted))
        ),
        'surface counts': Kind('counts.yaml', read_surface_counts, tuple(map(_yaml, counts))),
        'grasps': Kind(
            'grasps.yaml',
            lambda path: check_grasps(ra.load_grasps(path), known.placements, [1]),
            ((CONFIG / 'grasps' / 'l_bracket.yaml').read_bytes(),),
        ),
    }


def result_kinds(part: ra.Part, folder: Path) -> dict[str, Kind]:
    """Return the kinds of files that the suite itself writes."""
    result = ra.drop(part, drops=20, seed=1, log=folder / 'logs', workers=1)
    (log,) = (folder / 'logs').rglob('*.mcap')
    slope = ra.drop(part, drops=10, surroundings='slope', workers=1)
    store = folder / 'seed.jsonl'
    points = PointStore(store, {'numpy': '2'})
    points.add('a', 10, np.array([[4, 6]]))
    points.add('b', 20, np.array([[5, 5], [6, 4]]))

    def stored(path: Path) -> None:
        PointStore(path, {'numpy': '2'})

    shape = {'outer': [[0, 0], [0.04, 0], [0.04, 0.02], [0, 0.02]]}
    holes = [[[0.01, 0.005], [0.02, 0.005], [0.02, 0.01]]]
    return {
        'result': Kind(
            'result.json',
            lambda path: document_result(path, None, None, None, None),
            (result.to_json().encode(), slope.to_json().encode()),
        ),
        'counted': Kind('counted.json', read_counts, (result.to_json().encode(),)),
        'polygon': Kind(
            'polygon.json', read_polygon, (_json(shape), _json({**shape, 'holes': holes}))
        ),
        'points': Kind('points.jsonl', stored, (store.read_bytes(),)),
        'log': Kind('run.mcap', ra.read_log, (log.read_bytes(),)),
    }


def csv_kinds() -> dict[str, Kind]:
    """Return the kinds of CSV files."""
    poses = 'drop,status,qx,qy,qz,qw\n0,SETTLED,0,0,0,1\n1,FAILED,,,,\n2,settled,0.6,0,0.8,0\n'
    states = 'z_com_m,qx,qy,qz,qw,x_m,vx,wz\n0.1,0,0,0,1,0,0.5,3\n0.2,0,0.6,0,-0.8,1e-2,0,-1\n'
    seen = (
        'class,count,batch\n1,5,a\n2,7,a\n1,4,b\n',
        'time;class;count\n10:00;1;4\n10:00;2+3;6\n10:01;1;5\n',
    )
    return {
        'counts': Kind(
            'counts.csv',
            read_counts,
            (b'aspect,count\n1,5\n2,7\nunsettled,1\n', b'class;count\n1;5\n2+3;7\n'),
        ),
        'observed': Kind(
            'observed.csv',
            lambda path: read_observed(path, [1, 2, 3]),
            tuple(text.encode() for text in (*seen, 'class\n1\n2\n1\n')),
        ),
        'poses': Kind('poses.csv', lambda path: read_pose_csv(path, 1), (poses.encode(),)),
        'states': Kind('states.csv', read_state_csv, (states.encode(),)),
    }


# A prism with polygons of 5 and 4 corners.
PRISM = """OFF  # a comment
10 7 15
0 0 0
20 0 0
25 10 0
10 20 0
-5 10 0
0 0 8
20 0 8
25 10 8
10 20 8
-5 10 8
5 4 3 2 1 0
5 5 6 7 8 9
4 0 1 6 5
4 1 2 7 6
4 2 3 8 7
4 3 4 9 8
4 4 0 5 9
"""


def mesh_kinds() -> dict[str, Kind]:
    """Return the kinds of meshes."""
    box = trimesh.creation.box((10, 20, 30))
    corners = np.array(np.meshgrid((0, 1), (0, 1), (0, 1), indexing='ij')).reshape(3, 8).T
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    binary, text = box.export(file_type='stl'), box.export(file_type='stl_ascii')
    obj, ply = box.export(file_type='obj'), box.export(file_type='ply', encoding='ascii')
    pair = trimesh.Scene({'one': box, 'other': box.copy().apply_translation((0, 0, 30))})
    meshes = {
        'stl': (binary, text),
        'obj': (obj,),
        'ply': (ply, box.export(file_type='ply')),
        'step': (step_text(corners * 10, sides),),
        'off': (box.export(file_type='off'), PRISM),
        'glb': (box.export(file_type='glb'), pair.export(file_type='glb')),
        '3mf': (box.export(file_type='3mf'), pair.export(file_type='3mf')),
    }
    return {
        f'mesh {ending}': Kind(
            f'mesh.{ending}',
            ra.load_part,
            tuple(each.encode() if isinstance(each, str) else each for each in seeds),
        )
        for ending, seeds in meshes.items()
    }


def _yaml(document: object) -> bytes:
    return yaml.safe_dump(document, sort_keys=False).encode()


def _json(document: object) -> bytes:
    return json.dumps(document).encode()
